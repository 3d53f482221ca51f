"""What every task reports of made-up trials: tables, findings, notes, settings and figures, as they were.

`KINREACH_KEEP=1 pytest tests/compare/test_reporting.py` keeps them as they are now; read the change in git.
"""

import math
from dataclasses import replace
from functools import partial
from io import StringIO
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex

from kinreach._statistics import summarise, tables
from kinreach._terminal import Console
from kinreach.compare import Method, _report, _runner, get_task
from kinreach.compare._lift import CAUSES
from kinreach.compare._motion import with_motion
from kinreach.compare._ranking import Ranking
from kinreach.compare._real_arm import ALL, ALONE
from kinreach.compare._runner import Comparison, notes, results_of
from kinreach.compare._task import _OWN, SOLVER
from kinreach.envs.moving import PATHS, SPEEDS
from kinreach.envs.real_arm import BUDGETS
from tests.cases import slow
from tests.kept import KEEP

KEPT = Path(__file__).parents[1] / "data" / "reports"
#: Methods: how far their trials end from the goal [m], and the share of impossible ones.
METHODS = {"near": (2e-4, 0.0), "mixed": (8e-3, 0.25), "far": (0.3, 0.1), "none$": (0.4, 1.0)}
COUNT = 24
#: Tasks whose report takes half a second.
QUICK = ("lift", "moving", "obstacles", "push", "pick-and-place")


def trials_of(name, distance, impossible):
    """Trials with all that any task reads."""
    rng = np.random.default_rng(sum(map(ord, name)))
    for index, speed, path, clutter, errors in zip(
        range(COUNT), cycle(SPEEDS), cycle(PATHS), cycle((0, 4, 16)), cycle((ALL, *ALONE)), strict=False
    ):
        goal = rng.uniform((0.3, -0.3, -0.2), (0.65, 0.3, -0.1))
        seen, meant, tip = goal + rng.normal(0.0, (distance / 20, distance / 9, distance / 2), (3, 3)).T
        refused = bool(rng.uniform() < impossible)
        off = float(np.linalg.norm(tip - goal))
        reached = off < 0.01 and not refused
        yield {
            "goal_index": index, "method": name, "goal": goal.tolist(), "seen": seen.tolist(),
            "target_tip": meant.tolist(), "tip": tip.tolist(), "q": [0.1] * 6, "distance": off,
            "posture_error": float(rng.uniform(0, 0.2)), "reached": reached, "impossible": refused,
            "status": "collision" if refused else "completed", "steps": int(rng.integers(1, 90)),
            "reward": 20 - 30 * off, "return": -50 * off, "solve_s": float(rng.uniform(1e-3, 1e-2)),
            "accept_s": float(rng.uniform(1e-4, 1e-3)),
            "move_s": float(rng.uniform(1, 3)), "iterations": int(rng.integers(0, 9)), "restarts": int(refused),
            "candidates": int(rng.integers(1, 4)), "wrong_presses": int(rng.integers(0, 4)), "attempts": 1 + refused,
            "energy": float(rng.uniform(5, 90)), "clutter": clutter, "length": float(rng.uniform(1, 6)), "speed": speed,
            "path": path, "time": float(rng.uniform(0.3, 2)), "clearance": 0.2 * reached, "errors": errors,
            "cause": "" if reached else CAUSES[index % len(CAUSES)],
            **{f"error_{b}_{a}": off / (1 + (b + 9 * a) * (name == "near")) for b in BUDGETS for a in range(3)},
            **{f"motion_{part}": float(rng.uniform(0.2, 1)) for part in ("s", "speed", "acceleration", "jerk")},
        }  # fmt: skip


def replayed(name, goal):
    turns = np.linspace(0, 1, 5)
    return [
        {"goal": [0.4 + 0.1 * t, 0.02 * goal, -0.175], "q": [t, -1.5, 1.5, -1.5, -1.5, 0.0],
         "is_success": name == "near", "distance": 0.0123}
        for t in turns
    ]  # fmt: skip


def of(*values):
    """Numbers in three digits, the rest as texts; of many their number, the ends and the mean."""
    found = []
    for value in values:
        if isinstance(value, str | bool | None):
            found.append(str(value).replace("\n", " | "))
        elif np.size(value) > 6:
            part = np.ravel(value).astype(float)
            part = part[np.isfinite(part)]
            assert part.size, "no number in a figure: trials_of lacks an entry that a column reads"
            found.append(f"{np.size(value)}x[{of(part[0], part[-1], part.min(), part.mean(), part.max())}]")
        else:
            found.append(",".join(f"{0.0 if abs(n) < 1e-12 else n:.3g}" for n in np.ravel(value).astype(float)))
    return " ".join(found)


def drawn(figure):
    """Everything in a figure, a line each."""
    yield f"figure {of(figure.get_size_inches(), figure.get_suptitle(), figure.get_supxlabel())}"
    for axes in figure.axes:
        yield f" axes {of(axes.get_title(loc='left'), axes.get_xlabel(), axes.get_ylabel())}"
        for side in (axes.xaxis, axes.yaxis):
            kinds = (side.get_major_locator(), side.get_major_formatter(), side.get_minor_formatter())
            names = " ".join(type(kind).__name__ for kind in kinds)
            labels = [label.get_text() + label.get_color() * bool(label.get_text()) for label in side.get_ticklabels()]
            shown = side.get_tick_params().get("labelleft", True), side.get_tick_params().get("labelbottom", True)
            yield f"  {side.axis_name} {side.get_scale()} {of(side.get_view_interval())} {names} {shown} {labels}"
            yield f"   grid {side.get_tick_params().get('gridOn', False)}"
        for line in axes.lines:
            look = line.get_marker(), line.get_linestyle(), line.get_color(), to_hex(line.get_markerfacecolor())
            numbers = line.get_linewidth(), line.get_markersize(), line.get_markeredgewidth(), line.get_zorder()
            yield f"  line {of(*map(str, look), *numbers, *map(np.ravel, line.get_data()), str(line.get_label()))}"
        for part in axes.collections:
            corners = (
                np.concatenate([path.vertices for path in part.get_paths()]) if part.get_paths() else np.zeros((1, 2))
            )
            colours = [to_hex(colour, keep_alpha=True) for colour in part.get_facecolor()[:1]]
            where = np.asarray(part.get_offsets()), corners
            yield f"  {type(part).__name__} {colours} {of(*(array[:, axis] for array in where for axis in (0, 1)))}"
        for patch in axes.patches:
            bounds = patch.get_path().get_extents(patch.get_patch_transform()).bounds
            yield f"  patch {of(bounds, to_hex(patch.get_facecolor()), str(patch.get_label()))}"
        for text in axes.texts:
            place = text.xy if hasattr(text, "xy") else text.get_position()
            look = text.get_color(), text.get_weight(), text.get_ha(), text.get_va()
            yield f"  text {of(text.get_text(), place, text.get_fontsize(), *map(str, look))}"
        if legend := axes.get_legend():
            entries = [entry.get_text() for entry in legend.get_texts()]
            yield f"  legend {entries} {of(legend._ncols, legend.get_bbox_to_anchor()._bbox.bounds)}"


def reported(task):
    """Everything that people read of a task's results."""
    methods = {name: Method(lambda env: None, SOLVER) for name in METHODS}
    comparison = Comparison(task, methods, COUNT, 3, "again $1", {"lost": "it is missing"}, "ur5", True)
    trials = [trial for name, (far, refused) in METHODS.items() for trial in trials_of(name, far, refused)]
    results = results_of(comparison, trials, {"processor": "one"})
    results["versions"] = {"kinreach": "0", "placo": None}
    yield from Ranking(task, results, trials).finding()
    text = StringIO()
    for table in tables(task.columns, results["methods"], title=results["settings"]["title"], width=100):
        Console(file=text, width=1000).print(table)
    yield from (line.rstrip() for line in text.getvalue().splitlines())
    yield from notes(task, results)
    yield from (f"{name}: {words}" for name, words in _report._words(task, results))
    for column in task.columns:
        mine = [column.read(entry) for entry in results["methods"]]
        flat = [value for part in mine for value in (part.values() if isinstance(part, dict) else [part])]
        yield f"{column.key} {of([math.nan if value is None else value for value in flat])}"
    before = list(_OWN)[: list(_OWN).index(task.name)]
    elsewhere = [draw for name in before for draw in get_task(name).figures.values()]
    for name, draw in task.figures.items():
        if draw not in elsewhere:
            yield name
            yield from drawn(draw(trials, results))
    if task.paths is not None:
        yield from drawn(task.paths(trials, results, replayed))


@pytest.mark.parametrize("name", [*QUICK, *slow(*(name for name in _OWN if name not in QUICK))])
def test_reports_are_as_they_were(name, monkeypatch):
    monkeypatch.setattr(_runner, "summarise", partial(summarise, resamples=20))
    task = get_task(name)
    named = replace(task, reached="reached", terms={term: term for term in task.terms})  # texts are kept elsewhere
    path = KEPT / f"{name}.txt"
    if KEEP:
        path.write_text("\n".join(reported(with_motion(named))) + "\n", encoding="utf-8")
    kept = path.read_text(encoding="utf-8").splitlines()
    known = {line.split()[0] for line in kept if line}  # a new column is compared once it is kept
    lines = list(reported(with_motion(replace(named, columns=[one for one in task.columns if one.key in known]))))
    assert len(lines) > 30
    assert lines == kept

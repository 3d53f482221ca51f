"""Every figure is drawn as it was: data, words, colours, widths and places, to a tenth of a point.

`KINREACH_KEEP=1 pytest tests/plots/test_drawn.py` keeps what is drawn now; a test that fails says where the drawing is.
"""

import hashlib
import os
import re
from io import StringIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from kinreach._plots._maps import draw_error_maps
from kinreach._plots._motion import draw_motion
from kinreach._plots._style import label_ends, new_figure
from kinreach._plots._workspace import draw_workspace
from kinreach.compare._curves import draw_looks, draw_pressed, draw_shares, draw_success
from kinreach.compare._figures import draw_budget, draw_errors, draw_map, draw_strip_grid, draw_times
from kinreach.compare._lift import CAUSES, draw_causes
from kinreach.compare._moving import draw_paths
from kinreach.kinematics import Trajectory, URKinematics

KEPT = Path(__file__).parents[1] / "data" / "drawn.txt"
COLOURS = {"a": "#0072B2", "b$": "#D55E00", "never": "#009E73"}
GOALS = 12
MM = ("0.5", "5", "50")


def trials(**more):
    """Three methods, the last of which reaches nothing."""
    rng, found = np.random.default_rng(0), []
    for number, name in enumerate(COLOURS):
        for index in range(GOALS):
            distance = float(10 ** rng.uniform(-5, -2)) if name != "never" else 1.0
            found.append({
                "method": name, "goal_index": index, "distance": distance, "reached": distance < 5e-3,
                "impossible": name == "never" and index > 6, "solve_s": 1e-4 * (index + 1 + number),
                "accept_s": 2e-5 if number else None, "steps": 10 * index + number, "speed": (0.2, 0.4)[index % 2],
                "path": ("straight", "circle")[index % 2], "goal": [*rng.uniform((0.3, -0.3), (0.65, 0.3)), 0.0],
                "posture_mm": 1e3 * distance / 7 if index else 0.0, "seen_mm": 0.1 * (1 + index),
                **{name: make(index, number) for name, make in more.items()},
            })  # fmt: skip
    return found


def results():
    methods = []
    for name, colour in COLOURS.items():
        own = [trial for trial in trials() if trial["method"] == name]
        shares = {mm: sum(1e3 * t["distance"] < float(mm) for t in own) / GOALS for mm in MM}
        reached = sum(trial["reached"] for trial in own) / GOALS
        part = {"seeing": 0.13, "deciding": -0.004, "moving": 2e-9, "distance": 0.126000002}
        methods.append({
            "name": name, "colour": colour, "goals": GOALS, "reached": reached,
            "reached_ci": (0.9 * reached, 0.9 * reached + 0.1), "success_at_mm": shares,
            "success_at_mm_ci": {mm: (0.9 * share, 0.9 * share + 0.1) for mm, share in shares.items()},
            "failed": {cause: 0.01 * place for place, cause in enumerate(CAUSES)},
            "budget_mm": dict.fromkeys(part, 0.0 if name == "b$" else None) if name != "a" else part,
            "budget_mm_ci": {"seeing": [0.12, 0.14], "deciding": [-0.01, 0.002]},
        })  # fmt: skip
    return {"methods": methods, "settings": {"goals": GOALS, "seed": 3, "command": "run $x"}}


def replay(name, goal):
    t = np.linspace(0.0, 1.0, 5)[:, None]
    q = np.array([-1.6, -1.5, 1.6, -1.5, -1.6, 0.0]) + t * np.array([0.3, 0.1, 0.1, 0.0, 0.0, 0.0]) * (goal + 1)
    return [
        {"goal": np.array([0.4, 0.1 * s, 0.0]), "q": each, "is_success": name == "a", "distance": 0.02}
        for s, each in zip(t[:, 0], q, strict=True)
    ]


def workspace(*, calibrated):
    kin = URKinematics("ur5e")
    return draw_workspace(kin, URKinematics("ur5") if calibrated else None, seed=3)


def named_ends(side):
    figure, (axes,) = new_figure("title", size=(6, 3), note="note", grid="y")
    label_ends(axes, {"a": (0.0, 0.5), "b": (1.0, 0.52), "c": (1.0, 0.5), "d": (0.5, 0.9)}, {
        "a": "#0072B2", "b": "#D55E00", "c": "#F0E442", "d": "#56B4E9"}, side=side)  # fmt: skip
    return figure


def grid_maps():
    xy = np.stack(np.meshgrid(np.linspace(0.3, 0.6, 4), np.linspace(-0.2, 0.2, 3)), axis=-1).reshape(-1, 2)
    errors = np.geomspace(0.1, 500.0, len(xy))
    errors[[2, 7]] = np.nan
    area = ((0.35, 0.5), (-0.1, 0.1))
    return draw_error_maps({"one": (xy, errors), "none": (xy, errors * np.nan)}, title="t", area=area, note="n")


def looks(budget, again):
    return lambda trial: trial[f"error_{budget}_{again}"]


def motion():
    t, ends = np.linspace(0.0, 2.0, 5), np.array([-2.0, 1.0, 1.1])
    q, qd = ends * t[:, None] ** 2 / 4.0, ends * t[:, None] / 2.0
    return draw_motion(Trajectory(("a_joint", "b", "c"), t, q, qd), np.full(3, 4.0), "a motion")


DRAWN = {
    "errors": lambda: draw_errors(lambda t: t["posture_mm"], lambda t: None, near_mm=10.0)(trials(), results()),
    "errors_seen": lambda: draw_errors(lambda t: t["posture_mm"], lambda t: t["seen_mm"], near_mm=10.0)(
        trials(), results()
    ),
    "times": lambda: draw_times(trials(), results()),
    "budget": lambda: draw_budget(("seeing", "deciding", "moving"), "meaning")([], results()),
    "map": lambda: draw_map(trials(), results()),
    "strips": lambda: draw_strip_grid(
        "title",
        {"steps": (lambda t: t["steps"], True), "mm": (lambda t: 1e3 * t["distance"], False),
         "some": (lambda t: t["steps"] if t["reached"] else None, True)},
        marks={"mm": 5.0}, legend="legend",
    )(trials(), results()),
    "success": lambda: draw_success(trials(), results()),
    "pressed": lambda: draw_pressed(trials(), results()),
    "shares": lambda: draw_shares("speed", title="title", label="speed [m/s]", of="balls")(trials(), results()),
    "counts": lambda: draw_shares("count", title="title", label="obstacles", of="goals")(
        trials(count=lambda index, number: index % 3), results()
    ),
    "looks": lambda: draw_looks((0, 5, 50), looks)(
        trials(**{
            f"error_{budget}_{again}": lambda index, number, size=(2.0 + again) / (1 + budget): (
                5.0 + 1e-5 * index if number == 1 else (1.0 + 0.1 * index) * size
            )
            for budget in (0, 5) for again in (0, 1)
        }),
        results(),
    ),
    "causes": lambda: draw_causes([], results()),
    "paths": lambda: draw_paths(trials(), results(), replay),
    "motion": motion,
    "maps": grid_maps,
    "names_right": lambda: named_ends("right"),
    "names_left": lambda: named_ends("left"),
    "workspace": lambda: workspace(calibrated=False),
    "deviation": lambda: workspace(calibrated=True),
}  # fmt: skip


def drawing(figure):
    """Return a figure as SVG without names that matplotlib makes up, its numbers rounded."""
    colours = []
    for cells in figure.findobj(QuadMesh):  # tens of thousands of paths
        colours += [f"{value:.3g}" for value in np.ma.filled(cells.get_array(), np.nan).ravel()[::7]]
        cells.remove()
    text = StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "kinreach"}):
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    svg = text.getvalue() + " ".join(colours)
    svg = re.sub(r'id="[^"]*"|#[a-zA-Z]\w{7,}|<!--.*?-->', "", svg, flags=re.DOTALL)
    return re.sub(r"-?\d+\.\d+", lambda number: f"{float(number[0]):.1f}".replace("-0.0", "0.0"), svg)


@pytest.mark.parametrize("name", DRAWN)
def test_a_figure_is_drawn_as_it_was(name, tmp_path):
    version, *lines = KEPT.read_text(encoding="utf-8").splitlines()
    kept = dict(line.split() for line in lines)
    svg = drawing(DRAWN[name]())
    found = hashlib.sha256(svg.encode()).hexdigest()[:16]
    if os.environ.get("KINREACH_KEEP"):
        rows = "".join(f"{each} {digest}\n" for each, digest in sorted((kept | {name: found}).items()) if each in DRAWN)
        KEPT.write_text(f"matplotlib {mpl.__version__}\n{rows}", encoding="utf-8")
    elif version != f"matplotlib {mpl.__version__}":
        pytest.skip(f"kept with {version}, here is {mpl.__version__}")
    else:
        (tmp_path / f"{name}.svg").write_text(svg, encoding="utf-8")
        assert found == kept[name], f"the figure is drawn otherwise: {tmp_path / f'{name}.svg'}"

"""The command line: plans problem by problem, keeps what is measured, and writes the table."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import FuncFormatter

from benchmarks.paths.planners import PLANNERS
from benchmarks.paths.problems import KINDS, MARGIN, Problem, generated, ur5e, vamp, vamp_ur5
from benchmarks.speed.report import table
from kinreach._checks import check_count, check_path
from kinreach._files import make_writable, replacing, write_text
from kinreach._provenance import machine, versions
from kinreach.cli import Parser
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.kinematics.inside import travel
from kinreach.plots._colours import colours_of
from kinreach.plots._style import new_figure, plain

OUT = "results/paths"
PACKAGES = ("kinreach", "ompl", "pin", "numpy")
#: A path counts as found in time within so much processor time [s].
LIMIT = 1.0
#: `plan_path` to all solutions has so much wall time, and the other planners so much [s].
PATIENCE, RIVALS_PATIENCE = 60.0, 8.0
#: Samples of a path that is judged: no joint moves farther from one to the next [rad].
DENSE = 0.002
#: Of each kind, so many problems are planned by the other planners, and so many of VAMP's are taken.
RIVALS, OF_VAMP = 10, 15
#: Of each kind, so many are planned to each posture of the goal alone.
EACH = 70
COLUMNS = ("problems", "planner", "of", "solved [%]", "median [ms]", "p95 [ms]", "travel [rad]", "collisions")


def main(argv: Sequence[str], *, prog: str) -> int:
    """Measure, and write the page with its figure.

    Raises:
        KinreachError: Bad input, or results cannot be written.
    """
    parser = Parser(prog=prog, description="Planners on problems around a table, in a bookshelf and in a cage.")
    parser.add_argument("--problems", type=int, default=100, metavar="N", help="of each kind (default: %(default)s)")
    parser.add_argument("--vamp", metavar="DIR", help="VAMP's resources/ur5, for some of its problems, too")
    parser.add_argument("--docs", metavar="FILE", help="write the page there, such as docs/reference/paths.md")
    parser.add_argument("--out", default=OUT, metavar="DIR", help="where results are kept (default: %(default)s)")
    arguments = parser.parse_args(argv)
    count = check_count("--problems", arguments.problems)
    out = check_path("--out", arguments.out)
    make_writable(out)
    folder = check_path("--vamp", arguments.vamp) if arguments.vamp else None
    page = check_path("--docs", arguments.docs) if arguments.docs else out / "paths.md"
    make_writable(page.parent)
    rows = list(_measured(count, folder, out / "rows.jsonl"))
    command = (
        f"{prog} --problems {count}"
        + (" --vamp DIR" if folder else "")
        + (f" --docs {arguments.docs}" if arguments.docs else "")
    )
    picture = page.parent / "paths.png" if not arguments.docs else page.parents[1] / "images" / "paths.png"
    with replacing(picture) as file:
        _figure(rows).savefig(file, format="png", dpi=150)
    write_text(page, "\n\n".join(_parts(rows, os.path.relpath(picture, page.parent), command)) + "\n")
    print(f"Written: {page}, {picture}")
    return 0


def _measured(count: int, folder: Path | None, file: Path) -> Iterator[dict[str, Any]]:
    """A row for each problem and planner; those in the file are not measured again.

    Of each kind problems are generated until that many are solved by any planner.
    """
    identity = versions(PACKAGES)
    known: dict[tuple[str, ...], dict[str, Any]] = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        row = json.loads(line)
        if row["identity"] == identity:
            known[row["set"], row["kind"], row["index"], row["planner"]] = row
    with open(file, "a", encoding="utf-8") as kept:

        def rows(name: str, kin: ArmKinematics, problem: Problem) -> list[dict[str, Any]]:
            checker, found = None, []
            for planner in PLANNERS:
                of_these = {"kinreach": math.inf, "kinreach, each alone": EACH}.get(planner, RIVALS)
                if planner != "kinreach" and (name != "generated" or problem.index >= of_these):
                    continue
                key = (name, problem.kind, problem.index, planner)
                if key not in known:
                    checker = checker or CollisionChecker(kin, obstacles=problem.obstacles, margin=MARGIN)
                    row = _plan(kin, checker, problem, planner)
                    known[key] = dict(zip(("set", "kind", "index", "planner"), key, strict=True)) | row
                    kept.write(json.dumps(known[key] | {"identity": identity}) + "\n")
                    kept.flush()
                found.append(known[key])
            return found

        for kind in KINDS:
            solved, problems = 0, generated(kind)
            while solved < count:
                of_problem = rows("generated", ur5e(), next(problems))
                solved += any(row["solved"] for row in of_problem)
                yield from of_problem
        for problem in vamp(folder) if folder is not None else ():
            if problem.index <= OF_VAMP:
                yield from rows("VAMP", vamp_ur5(folder), problem)


def _plan(kin: ArmKinematics, checker: CollisionChecker, problem: Problem, planner: str) -> dict[str, Any]:
    goals = kin.all_solutions(kin.fk(problem.goal))
    if not checker.free(problem.start) or not any(checker.free(q) for q in goals.q):
        return {"valid": False}
    began = time.process_time()
    patience = PATIENCE if planner == "kinreach" else RIVALS_PATIENCE
    path = PLANNERS[planner](checker, problem.start, goals, patience)
    seconds = time.process_time() - began
    if path is None:
        return {"valid": True, "solved": False, "seconds": seconds}
    exact = CollisionChecker(kin, obstacles=problem.obstacles)
    parts = [
        a + np.linspace(0.0, 1.0, int(np.ceil(np.abs(b - a).max() / DENSE)) + 1)[:, None] * (b - a)
        for a, b in pairwise(path)
    ]
    hit = int(exact.impossible(np.vstack(parts)).sum())
    return {"valid": True, "solved": True, "seconds": seconds, "travel": travel(path), "collisions": hit}


def _in_time(row: dict[str, Any]) -> bool:
    return row["solved"] and row["seconds"] <= LIMIT


def _line(name: str, planner: str, rows: Sequence[dict[str, Any]]) -> list[Any]:
    solved = [row for row in rows if _in_time(row)]
    seconds = [row["seconds"] if _in_time(row) else np.inf for row in rows]
    times = [float(1e3 * np.quantile(seconds, at, method="higher")) for at in (0.5, 0.95)]
    return [
        name,
        planner,
        len(rows),
        100.0 * len(solved) / len(rows),
        *(value if np.isfinite(value) else f"above {1e3 * LIMIT:.0f}" for value in times),
        float(np.median([row["travel"] for row in solved])) if solved else None,
        sum(row["collisions"] > 0 for row in solved),
    ]


def _parts(rows: Sequence[dict[str, Any]], picture: str, command: str) -> Iterator[str]:
    valid = [row for row in rows if row["valid"]]
    problems = {(row["set"], row["kind"], row["index"]) for row in valid}
    solvable = {(row["set"], row["kind"], row["index"]) for row in valid if row["solved"]}
    unsolved_of_vamp = [f"{kind} {index}" for name, kind, index in sorted(problems - solvable) if name == "VAMP"]
    kept = [row for row in valid if (row["set"], row["kind"], row["index"]) in solvable]
    ours = [row for row in valid if row["planner"] == "kinreach" and row["set"] == "generated"]
    solved = [row for row in ours if (row["set"], row["kind"], row["index"]) in solvable]
    wrong = sum(row.get("collisions", 0) > 0 for row in kept if row["planner"].startswith("kinreach"))
    late = [f"{row['kind']} {row['index']}, {row['seconds']:.1f} s" for row in solved if not _in_time(row)]
    here = machine()
    yield "# Paths around obstacles"
    yield f"<!-- written by `{command}`; do not edit -->"
    yield (
        f"`plan_path` solves {100 * np.mean([_in_time(row) for row in solved]):.1f} % of {len(solved)} generated "
        f"problems within {LIMIT:g} s of processor time, half of them within "
        f"{1e3 * np.median([row['seconds'] for row in solved]):.0f} ms. {wrong} of its paths collide."
    )
    ratios = _beside_each_alone(kept)
    yield (
        "It takes the near way: no joint turns farther than it has to, over all postures of the goal and the detours "
        f"to them. On {len(ratios)} problems the largest way of a joint is at most {max(ratios):.2f} times the least "
        f"of planning to each posture alone, more than 1.2 times in {sum(ratio > 1.2 for ratio in ratios)} and less "
        f"than 1 / 1.2 in {sum(ratio < 1.0 / 1.2 for ratio in ratios)}."
    )
    yield f"![Share of problems solved against time, a line for each planner]({picture})"
    yield (
        "A UR5e with a gripper reaches between objects on a table, into a bookshelf, and into a cage. A pose of the "
        f"tool is the goal. The margin is {1e3 * MARGIN:g} mm. Each path is then sampled every {DENSE:g} rad, and the "
        "collision checker without a margin judges the samples; collisions counts paths with any. Times are the "
        "processor's, of planning, shortening, proof and the search for a nearer way; the checker is built before. "
        "Travel is the largest way of a joint, the median over the problems."
    )
    unsolved = [f"{row['kind']} {row['index']}" for row in ours if row not in solved]
    counted = (
        "A scene is drawn at random, and may have no path. As in MotionBenchMaker's problems, which VAMP takes, a "
        f"problem counts only if some planner solves it within {PATIENCE:g} s of wall time."
    )
    if unsolved:
        drawn = 100 * np.mean([_in_time(row) for row in ours])
        counted += (
            f" Without a known path, and replaced by the next: {', '.join(unsolved)}. Of all {len(ours)} that were "
            f"drawn, {drawn:.1f} % are solved within {LIMIT:g} s."
        )
    if late:
        counted += f" Longer took {'; '.join(late)}."
    yield counted
    yield (
        "Rivals are OMPL's RRTConnect, LBKPIECE1 and BKPIECE1 with their own settings. They get all solutions as goals "
        f"and the same proof for each motion, on the first {RIVALS} problems of each kind, {RIVALS_PATIENCE:g} s of "
        "wall time each. *RRTConnect, as kinreach* is OMPL's with the settings of `plan_path`: its steps and "
        "distances, a coarse search, the shortening, and the proof at the end. What is left between the two are the "
        "trees: `plan_path` always grows the smaller one, which is the one in the narrow place. After 3000 steps it "
        "grows postures next to obstacles only towards what is near. It has no calls between "
        "C++ and Python, and looks for a nearer way. *Each alone* is `plan_path` to one free solution after the other, "
        f"with 3 s of wall time each, on the first {EACH} problems of each kind. PRM* was not tried: "
        "from Python, OMPL's did not return. Nor was VAMP, which needs a compiler; its authors report some 0.1 ms, "
        "with spheres for the arm."
    )
    yield (
        "kinreach's planner was tuned: its longest step on a quarter of VAMP's problems and on other cages than those "
        "of the table. Its search step and its number of shortcuts were chosen on the first 24 problems of each kind "
        "here. How long it looks for a nearer way was chosen on the first 70, and on 80 scenes of `Obstacles-v0`. "
        "What is near was chosen on the cages 1, 7, 57 and 88. OMPL's planners "
        f"were not tuned, and ran on problems below {RIVALS} only."
    )
    lines = []
    for name, kind in dict.fromkeys((row["set"], row["kind"]) for row in kept):
        for planner in PLANNERS:
            of = [row for row in kept if (row["set"], row["kind"], row["planner"]) == (name, kind, planner)]
            if of:
                lines.append(_line(kind if name == "generated" else f"{name}: {kind}", planner, of))
    yield table(COLUMNS, lines)
    if unsolved_of_vamp:
        yield f"Left out of VAMP's problems, without a known path: {', '.join(unsolved_of_vamp)}."
    invalid = len({(row["set"], row["kind"], row["index"]) for row in rows}) - len(problems)
    if invalid:
        yield (
            f"Left out are {invalid} of VAMP's problems, where the start or every solution of the goal is within the "
            "margin of something: kinreach takes meshes by their convex hulls, VAMP by spheres."
        )
    found = ", ".join(f"{name} {version}" for name, version in versions(PACKAGES).items())
    yield (
        f"Machine: {here['processor']}, {here['cores']} cores, load {os.getloadavg()[2]:.0f}. Versions: {found}. "
        f"Again: `{command}`"
    )


def _beside_each_alone(rows: Sequence[dict[str, Any]]) -> list[float]:
    """Travel of `plan_path` in parts of the least of planning to each posture alone, where both find a path."""
    found = {
        (row["kind"], row["index"], row["planner"]): row["travel"]
        for row in rows
        if row["set"] == "generated" and row.get("travel")
    }
    pairs = ((found.get((kind, index, "kinreach")), least) for (kind, index, name), least in found.items()
             if name == "kinreach, each alone")  # fmt: skip
    return [ours / least for ours, least in pairs if ours is not None]


def _figure(rows: Sequence[dict[str, Any]]) -> Any:
    kept = [row for row in rows if row["set"] == "generated" and row["index"] < RIVALS and row["valid"]]
    figure, axes = new_figure("", size=(9.0, 3.2), columns=len(KINDS))
    colours = colours_of(PLANNERS)
    for panel, kind in zip(axes, KINDS, strict=True):
        for planner in PLANNERS:
            of = [row for row in kept if (row["kind"], row["planner"]) == (kind, planner)]
            times = np.sort([1e3 * row["seconds"] for row in of if row["solved"]])
            shares = 100.0 * np.arange(1, len(times) + 1) / max(len(of), 1)
            panel.step(times, shares, where="post", color=colours[planner], label=planner)
        panel.set(title=kind, xscale="log", xlim=(1.0, 4e3), ylim=(0, 102), xlabel="processor time [ms]")
        panel.xaxis.set_major_formatter(FuncFormatter(plain))
    axes[0].set_ylabel("problems solved [%]")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=(len(PLANNERS) + 1) // 2, frameon=False
    )
    return figure

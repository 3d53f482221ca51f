"""The command line: plans problem by problem, keeps what is measured, and writes the table."""

from __future__ import annotations

import json
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
from kinreach._plots._methods import colours_of
from kinreach._plots._style import new_figure, plain
from kinreach._provenance import machine, versions
from kinreach.cli import Parser
from kinreach.kinematics import ArmKinematics, CollisionChecker

OUT = "results/paths"
PACKAGES = ("kinreach", "ompl", "pin", "numpy")
#: A path counts as found in time within so much processor time; planners have so much time on the clock [s].
LIMIT, PATIENCE = 1.0, 8.0
#: Cages that no planner solves in that time, and one with more: see `HARD`.
SOLVED_LATER = (7, 57)
#: What `python -m benchmarks.paths.hard` printed, with its commands.
HARD = Path(__file__).with_name("hard.md")
#: Samples of a path that is judged: no joint moves farther from one to the next [rad].
DENSE = 0.002
#: Of each kind, so many problems are planned by the other planners, and so many of VAMP's are taken.
RIVALS, OF_VAMP = 10, 15
COLUMNS = ("problems", "planner", "of", "solved [%]", "median [ms]", "p95 [ms]", "length [rad]", "collisions")


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
    """A row for each problem and planner; those in the file are not measured again."""
    identity = versions(PACKAGES)
    known: dict[tuple[str, ...], dict[str, Any]] = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        row = json.loads(line)
        if row["identity"] == identity:
            known[row["set"], row["kind"], row["index"], row["planner"]] = row
    sets: list[tuple[str, ArmKinematics, Iterator[Problem]]] = [
        ("generated", ur5e(), (problem for kind in KINDS for problem in generated(kind, count)))
    ]
    if folder is not None:
        first = (problem for problem in vamp(folder) if problem.index <= OF_VAMP)
        sets.append(("VAMP", vamp_ur5(folder), first))
    with open(file, "a", encoding="utf-8") as kept:
        for name, kin, problems in sets:
            for problem in problems:
                checker = None
                for planner in PLANNERS:
                    if planner != "kinreach" and (name != "generated" or problem.index >= RIVALS):
                        continue
                    key = (name, problem.kind, problem.index, planner)
                    if key not in known:
                        checker = checker or CollisionChecker(kin, obstacles=problem.obstacles, margin=MARGIN)
                        row = _plan(kin, checker, problem, planner)
                        known[key] = dict(zip(("set", "kind", "index", "planner"), key, strict=True)) | row
                        kept.write(json.dumps(known[key] | {"identity": identity}) + "\n")
                        kept.flush()
                    yield known[key]


def _plan(kin: ArmKinematics, checker: CollisionChecker, problem: Problem, planner: str) -> dict[str, Any]:
    goals = kin.all_solutions(kin.fk(problem.goal))
    if not checker.free(problem.start) or not any(checker.free(q) for q in goals.q):
        return {"valid": False}
    began = time.process_time()
    path = PLANNERS[planner](checker, problem.start, goals, PATIENCE)
    seconds = time.process_time() - began
    if path is None:
        return {"valid": True, "solved": False, "seconds": seconds}
    exact = CollisionChecker(kin, obstacles=problem.obstacles)
    parts = [
        a + np.linspace(0.0, 1.0, int(np.ceil(np.abs(b - a).max() / DENSE)) + 1)[:, None] * (b - a)
        for a, b in pairwise(path)
    ]
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    hit = int(exact.impossible(np.vstack(parts)).sum())
    return {"valid": True, "solved": True, "seconds": seconds, "length": length, "collisions": hit}


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
        float(np.median([row["length"] for row in solved])) if solved else None,
        sum(row["collisions"] > 0 for row in solved),
    ]


def _parts(rows: Sequence[dict[str, Any]], picture: str, command: str) -> Iterator[str]:
    valid = [row for row in rows if row["valid"]]
    problems = {(row["set"], row["kind"], row["index"]) for row in valid}
    solvable = {(row["set"], row["kind"], row["index"]) for row in valid if row["solved"]}
    open_ones = sorted(problems - solvable)
    kept = [row for row in valid if (row["set"], row["kind"], row["index"]) in solvable]
    ours = [row for row in valid if row["planner"] == "kinreach" and row["set"] == "generated"]
    attempted = [row for row in ours if (row["set"], row["kind"], row["index"]) in solvable]
    later = {("generated", "cage", index) for index in SOLVED_LATER}
    known = [row for row in ours if (row["set"], row["kind"], row["index"]) in solvable | later]
    seconds = [row["seconds"] for row in attempted]
    wrong = sum(row.get("collisions", 0) > 0 for row in kept if row["planner"].startswith("kinreach"))
    here = machine()
    yield "# Paths around obstacles"
    yield f"<!-- written by `{command}`; do not edit -->"
    yield (
        f"`plan_path` solves {100 * np.mean([_in_time(row) for row in ours]):.1f} % of {len(ours)} generated problems "
        f"within {LIMIT:g} s of processor time. That is {100 * np.mean([_in_time(row) for row in known]):.1f} % of the "
        f"{len(known)} that are known to have a path, and {100 * np.mean([_in_time(row) for row in attempted]):.1f} % "
        f"of the {len(attempted)} that any planner solves in {PATIENCE:g} s, half of them within "
        f"{1e3 * np.median(seconds):.0f} ms. "
        f"{wrong} of its paths collide."
    )
    yield f"![Share of problems solved against time, a line for each planner]({picture})"
    yield (
        "A UR5e with a gripper reaches between objects on a table, into a bookshelf, and into a cage. A pose of the "
        f"tool is the goal. The margin is {1e3 * MARGIN:g} mm. Each path is then sampled every {DENSE:g} rad, and the "
        "collision checker without a margin judges the samples; collisions counts paths with any. Times are the "
        "processor's, of planning, shortening and proof; the checker is built before. Length is the Euclidean norm "
        "over joints."
    )
    yield (
        "Rivals are OMPL's RRTConnect, LBKPIECE1 and BKPIECE1 with their own settings, all solutions as goals, and the "
        f"same proof for each motion, on the first {RIVALS} problems of each kind. All planners have {PATIENCE:g} s on "
        "the clock. *One goal* is `plan_path` to the nearest free solution "
        "alone: in a cage it is faster where it succeeds, which is less often. VAMP itself is not compared: it needs a "
        "compiler. Its authors report some 0.1 ms, with spheres for the arm."
    )
    yield (
        "kinreach's planner was tuned: its longest motion on a quarter of VAMP's problems, its search step and its "
        f"number of shortcuts on the first 24 problems of each kind here. The rivals were not, and only it ran on "
        f"problems {RIVALS} and up. It checks motions coarsely while it searches and proves the path at the end, where "
        "the rivals prove each motion. The gap is that of both, not of the algorithms alone. PRM* was not tried."
    )
    lines = []
    for name, kind in dict.fromkeys((row["set"], row["kind"]) for row in kept):
        for planner in PLANNERS:
            of = [row for row in kept if (row["set"], row["kind"], row["planner"]) == (name, kind, planner)]
            if of:
                lines.append(_line(kind if name == "generated" else f"{name}: {kind}", planner, of))
    yield table(COLUMNS, lines)
    if open_ones:
        named = ", ".join(f"{kind} {index}" for _, kind, index in open_ones)
        yield (
            f"Left out of the table are {len(open_ones)} problems that no planner solved within {PATIENCE:g} s: "
            f"{named}."
        )
    invalid = len({(row["set"], row["kind"], row["index"]) for row in rows}) - len(problems)
    if invalid:
        yield (
            f"Left out are {invalid} of VAMP's problems, where the start or every solution of the goal is within the "
            "margin of something: kinreach takes meshes by their convex hulls, VAMP by spheres."
        )
    yield HARD.read_text(encoding="utf-8").strip()
    found = ", ".join(f"{name} {version}" for name, version in versions(PACKAGES).items())
    yield (
        f"Machine: {here['processor']}, {here['cores']} cores, load {os.getloadavg()[2]:.0f}. Versions: {found}. "
        f"Again: `{command}`"
    )


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
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(PLANNERS), frameon=False)
    return figure

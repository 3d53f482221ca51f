"""Self-motions of eight seven-axis arms, and of each with errors in every joint: is a posture lost?

    python -m benchmarks.ik_arms.self_motions --postures 1000 --out docs/reference/self_motions.csv

For the pose of each random posture it checks that the curves have that posture, that they reach the pose, and that the
tip stands still along them. For the first `--full` postures it also checks that the curves have all of ssik's samples
and charts, and all that a grid twice as fine finds. One row a posture; the same command goes on after an interruption.
`python -m benchmarks.ik_arms --docs` puts the table into its page.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.ik_arms.arms import placements_of, ssik, urdf
from kinreach._checks import Floats, check_count, check_path
from kinreach._files import make_writable
from kinreach.cli import Parser, finish
from kinreach.kinematics._seven_axis.kinematics import SevenAxisKinematics
from kinreach.kinematics._seven_axis.tracing import Curve, SelfMotionTracer
from kinreach.robots import ArmDescription
from kinreach.robots._identification import moved_frames

PROG = "python -m benchmarks.ik_arms.self_motions"
#: Names in ssik.
ARMS = {
    "Panda": "franka_panda_ik", "FR3": "fr3_ik", "iiwa7": "iiwa7_ik", "iiwa14": "iiwa14_ik",
    "xArm7": "xarm7_ik", "Gen3": "gen3_ik", "Rizon4": "rizon4_ik", "KR810": "kassow_kr810_ik",
}  # fmt: skip
#: Largest error of each joint: along and about each axis [m, rad].
ERROR = 1e-3
#: By how much a pose may be missed, and the tip move along a curve [m, rad].
RIGHT = 1e-9
#: Postures of each arm that are compared with ssik's and with a finer grid's.
FULL = 68
#: Samples of each of ssik's charts.
CHART = 12
#: Columns that are filled for the first postures only.
COMPARED = ("samples", "samples lost", "charts lost", "finer lost")
COLUMNS = ("arm", "errors", "posture", "curves", "open", "lost", *COMPARED, "missed", "motion")


@cache
def arm_of(name: str, errors: bool) -> SevenAxisKinematics:
    """One of the arms as its maker drew it, or with `ERROR` in every joint."""
    placements = placements_of(ssik().Manipulator.from_prebuilt(ARMS[name]))
    if errors:
        placements = moved_frames(placements, np.random.default_rng(0).uniform(-ERROR, ERROR, (len(placements), 6)))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(urdf(placements), encoding="utf-8")
        return SevenAxisKinematics(ArmDescription.from_urdf(file))


def finer(kin: SevenAxisKinematics) -> SelfMotionTracer:
    """The same arm's curves from a grid twice as fine."""
    tracer = SelfMotionTracer(kin.chain)
    tracer._starts.values *= 2
    return tracer


def checked(name: str, errors: bool, posture: int, *, full: bool) -> dict[str, Any]:
    """A row of the table: what is wrong with the curves of one random posture's pose.

    Args:
        name: One of `ARMS`.
        errors: Whether its joints have errors.
        posture: Seed of the posture.
        full: Also compare the curves with ssik's postures and those of a finer grid. If not, these columns are empty.
    """
    kin = arm_of(name, errors)
    q = np.random.default_rng([posture, 7]).uniform(-np.pi, np.pi, 7)
    others: dict[str, Any] = dict.fromkeys(COMPARED, "")
    curves, found = faults(kin, q)
    if full:
        T = kin.fk(q)
        samples, charts = (np.empty((0, 7)), np.empty((0, 7))) if errors else theirs(name, T)
        more = np.vstack([np.empty((0, 7)), *(curve.q for curve in finer(kin).curves(T)[0])])
        counts = len(samples) + len(charts), *(_lost(kin, curves, each, T) for each in (samples, charts, more))
        others = dict(zip(COMPARED, counts, strict=True))
    return {"arm": name, "errors": int(errors), "posture": posture, **found, **others}


def faults(kin: SevenAxisKinematics, q: Floats) -> tuple[list[Curve], dict[str, Any]]:
    """The curves of a posture's pose; and what is wrong with them, by the column of the table."""
    T = kin.fk(q)
    motions = kin.self_motions(T, limits=False).curves
    curves = [Curve(curve.q, curve.closed, curve.tangent) for curve in motions]
    still = [np.einsum("mij,mj->mi", kin.jacobian(curve.q), curve.tangent) for curve in motions]
    return curves, {
        "curves": len(curves), "open": sum(not each.closed for each in curves), "lost": _lost(kin, curves, q[None], T),
        "missed": f"{max((np.abs(kin.fk(curve.q) - T).max() for curve in motions), default=0.0):.1e}",
        "motion": f"{max((np.abs(each).max() for each in still), default=0.0):.1e}",
    }  # fmt: skip


def _lost(kin: SevenAxisKinematics, curves: list[Curve], postures: Floats, T: Floats) -> int:
    """How many of those postures that reach a pose are on none of its curves."""
    right = np.abs(kin.fk(postures) - T).max(axis=(1, 2)) < RIGHT if len(postures) else []
    return len(kin._tracer.beside(curves, postures[right], T))


def faultless(row: dict[str, Any]) -> bool:
    """Whether a row says that nothing is lost or wrong."""
    exact = max(float(row["missed"]), float(row["motion"])) < RIGHT
    return exact and not any(int(row.get(key) or 0) for key in ("open", "lost", *COMPARED[1:]))


def theirs(name: str, T: Floats) -> tuple[Floats, Floats]:
    """Samples by ssik of a pose's postures, and of its charts, which few arms have."""
    arm = ssik().Manipulator.from_prebuilt(ARMS[name])
    samples = [one.q for one in arm.solve(T, respect_limits=False, enumerate_windings=False)]
    try:
        charts = [q for chart in arm.self_motion(T) for _, piece in chart.sample(CHART) for q in piece]
    except NotImplementedError:
        charts = []
    return np.array(samples).reshape(-1, 7), np.array(charts).reshape(-1, 7)


def summary(rows: Sequence[dict[str, str]]) -> Iterator[list[Any]]:
    """Rows of the page's table, one an arm; columns as `HEADINGS`."""
    for name in ARMS:
        for errors in ("0", "1"):
            mine = [row for row in rows if row["arm"] == name and row["errors"] == errors]
            compared = [row for row in mine if row["finer lost"]]
            if mine:
                total = {key: sum(int(row[key] or 0) for row in mine) for key in COLUMNS[3:10]}
                theirs_lost = total["samples lost"] + total["charts lost"]
                yield [
                    f"{name}, with errors" if errors == "1" else name,
                    f"{len(mine) - total['lost']} of {len(mine)}",
                    total["curves"] / len(mine),
                    f"{total['samples'] - theirs_lost} of {total['samples']}" if total["samples"] else None,
                    f"{sum(int(row['finer lost']) > 0 for row in compared)} of {len(compared)}",
                    total["open"],
                    max(float(row["missed"]) for row in mine),
                    max(float(row["motion"]) for row in mine),
                ]


HEADINGS = (
    "arm", "generating posture on a curve", "curves a pose", "ssik's postures on a curve",
    "poses with more by a finer grid", "curves that end", "pose missed [m, rad]", "tip moves [m/rad, rad/rad]",
)  # fmt: skip


def main() -> int:
    """Check posture by posture, arm by arm."""
    parser = Parser(prog=PROG, description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--postures", type=int, default=1000, metavar="N", help="of each arm (default: %(default)s)")
    parser.add_argument("--full", type=int, default=FULL, metavar="N", help="of them, compared (default: %(default)s)")
    parser.add_argument("--out", default="results/self_motions.csv", metavar="FILE", help="default: %(default)s")
    arguments: argparse.Namespace = parser.parse_args()
    count, out = check_count("--postures", arguments.postures), check_path("--out", arguments.out)
    full = check_count("--full", arguments.full, least=0)
    make_writable(out.parent)
    done = {(row["arm"], int(row["errors"]), int(row["posture"])) for row in read(out)}
    with open(out, "a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if not file.tell():
            writer.writeheader()
        for posture in range(count):
            for name in ARMS:
                for errors in (False, True):
                    if (name, int(errors), posture) not in done:
                        writer.writerow(checked(name, errors, posture, full=posture < full))
                        file.flush()
    return 0


def read(file: Path) -> list[dict[str, str]]:
    """The rows of a file, none if there is no file."""
    if not file.exists():
        return []
    with open(file, newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

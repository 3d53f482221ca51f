"""Which objects are lifted: by default, and over the range of shapes, sizes, masses and frictions.

    python -m benchmarks.studies.lift_range [closed-form placo POLICY.safetensors ...] [--objects 1000] [--seed 100]
        [--arm ur5e] [--figure docs/images/lift_beyond.png]

One attempt an object, under dynamics, in native batches; policies of small steps have 150 of them. The range: balls,
cubes and cylinders, 15 to 35 mm, 20 to 300 g, friction 0.3 to 1.5. Beyond it: 10 to 45 mm, 20 g to 1 kg, friction 0 to
0.4. The last column is episodes a second, by the clock on the wall. The figure shows the shares beyond the range, by
mass and friction, and by shape and size.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.studies.tables import head, line, share
from kinreach._checks import check_count
from kinreach._files import replacing
from kinreach._registration import LIFT
from kinreach.baselines._loop import rollout_batch
from kinreach.baselines._policies import load_policy
from kinreach.cli import Parser, finish
from kinreach.compare._lift import GraspPolicy
from kinreach.kinematics._solvers import SOLVERS, new_solver
from kinreach.plots._style import INK, new_figure

PROG = "python -m benchmarks.studies.lift_range"
RANGE = {
    "shapes": ("ball", "cube", "cylinder"),
    "sizes": (0.015, 0.035),
    "masses": (0.02, 0.3),
    "frictions": (0.3, 1.5),
}
BEYOND = {**RANGE, "sizes": (0.01, 0.045), "masses": (0.02, 1.0), "frictions": (0.0, 0.4)}
WORLDS: dict[str, dict[str, Any]] = {
    "default": {},
    "range": RANGE,
    "cubes": {**RANGE, "shapes": ("cube",)},
    "clutter": {**RANGE, "clutter": True},
    "beyond": BEYOND,
}
#: Environments in step; parts of the figure's axes.
BATCH, PARTS = 100, 5


class _Scripted:
    """A scripted grasp in a batch: it decides row by row."""

    def __init__(self, solver: str, env: gym.Env[Any, Any]) -> None:
        self._policy = GraspPolicy(new_solver(solver, env.unwrapped.kinematics), env)  # type: ignore[attr-defined]

    def reset(self, observations: Any, info: Any) -> None:
        """Begin: there is nothing to remember."""

    def act(self, observations: Any) -> np.ndarray:
        """Return an action for each row; where there is no grasp, a posture that touches nothing."""
        actions = [self._policy.act(row) for row in observations]
        return np.array([np.zeros(7) if action is None else action for action in actions])


def played(name: str, options: dict[str, Any], objects: int, seed: int, threads: int) -> tuple[dict[str, Any], float]:
    """Play one episode with each object; return arrays by name, and how many were played in a second of wall time."""
    options = {"dtype": "float64", **options}
    policy: Any = _Scripted(name, gym.make(LIFT, **options)) if name in SOLVERS else load_policy(name)
    if name not in SOLVERS:
        options = {**options, "steps": policy.needed_options.get("steps", "single")}
    trials: list[Any] = []
    start = time.perf_counter()
    batch = gym.make_vec(LIFT, BATCH, vectorization_mode="vector_entry_point", threads=threads, **options)
    for first in range(0, objects, BATCH):
        trials += rollout_batch(batch, policy, seed=seed + first)
    rate = len(trials) / (time.perf_counter() - start)
    batch.close()
    keys = ("is_success", "cause", "shape", "size", "mass", "friction")
    return {key: np.array([trial[key] for trial in trials[:objects]]) for key in keys}, rate


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("methods", nargs="*", default=["closed-form"], help="solvers, and policies by name or file")
    parser.add_argument("--objects", type=int, default=1000, help="of each world (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=100, help="of the objects (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=1, help="that step the dynamics (default: %(default)s)")
    parser.add_argument("--arm", default="ur5-thesis", help="default: %(default)s")
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS), choices=list(WORLDS), help="default: all")
    parser.add_argument("--figure", type=Path, help="where the shares beyond the range are drawn")
    arguments = parser.parse_args(argv)
    objects = check_count("--objects", arguments.objects, least=BATCH)
    seed = check_count("--seed", arguments.seed, least=0)
    print(head("world", "method", "lifted %", "not reached", "not closed", "slipped", "dropped", "a second"))
    over = {}
    for world in arguments.worlds:
        for name in arguments.methods:
            options = {**WORLDS[world], "arm": arguments.arm}
            found, rate = played(name, options, objects, seed, arguments.threads)
            counts = [int((found["cause"] == cause).sum()) for cause in ("reached", "closed", "slipped", "dropped")]
            lifted = share(int(found["is_success"].sum()), objects)
            label = Path(name).stem
            print(line(world, f"`{label}`", lifted, *counts, f"{rate:.0f}"), flush=True)
            if world == "beyond":
                over[label] = found
    if arguments.figure is not None and over:
        draw(over, objects, arguments.figure)
    return 0


def draw(found: dict[str, dict[str, Any]], objects: int, file: Path) -> None:
    """Draw the shares that are lifted, by mass and friction, and by shape and size; a row for each method."""
    (light, heavy), (slippery, rough), (small, large) = (BEYOND[name] for name in ("masses", "frictions", "sizes"))
    figure, axes = new_figure(
        "Objects lifted beyond the range, %", size=(9.0, 0.9 + 2.9 * len(found)), rows=len(found), columns=2,
        grid="none",
        note=f"{objects} objects a method, one attempt each; a cell without an object is empty",
    )  # fmt: skip
    for row, (name, rows) in enumerate(found.items()):
        mass, friction, size = (
            np.minimum(((rows[key] - low) / (high - low) * PARTS).astype(int), PARTS - 1)
            for key, low, high in (
                ("mass", light, heavy), ("friction", slippery, rough), ("size", small, large),
            )
        )  # fmt: skip
        shapes = np.array([RANGE["shapes"].index(shape) for shape in rows["shape"]])
        left, right = axes[2 * row], axes[2 * row + 1]
        _cells(left, rows["is_success"], friction, mass, (PARTS, PARTS))
        _cells(right, rows["is_success"], shapes, size, (len(RANGE["shapes"]), PARTS))
        left.set_title(name, loc="left", fontsize=10, color=INK, weight="bold")
        left.set_xticks(range(PARTS), _middles(light, heavy, 1e3))
        left.set_yticks(range(PARTS), _middles(slippery, rough, 1.0))
        left.set_xlabel("mass, middle of the cell [g]")
        left.set_ylabel("friction, middle of the cell")
        right.set_xticks(range(PARTS), _middles(small, large, 1e3))
        right.set_yticks(range(len(RANGE["shapes"])), RANGE["shapes"])
        right.set_xlabel("radius or half the edge, middle of the cell [mm]")
    with replacing(file) as temporary:
        figure.savefig(temporary, format="png")


def _middles(low: float, high: float, factor: float) -> list[str]:
    edges = np.linspace(low, high, PARTS + 1)
    return [f"{factor * middle:.3g}" for middle in (edges[1:] + edges[:-1]) / 2]


def _cells(axes: Any, lifted: np.ndarray, rows: np.ndarray, columns: np.ndarray, shape: Sequence[int]) -> None:
    total, good = np.zeros(shape), np.zeros(shape)
    np.add.at(total, (rows, columns), 1)
    np.add.at(good, (rows, columns), lifted)
    rates = 100 * np.divide(good, total, out=np.full(shape, np.nan), where=total > 0)
    axes.imshow(rates, cmap="cividis", vmin=0, vmax=100, aspect="auto", origin="lower")
    for (row, column), rate in np.ndenumerate(rates):
        if np.isfinite(rate):
            colour = INK if rate > 60 else "white"
            axes.text(column, row, f"{rate:.0f}", ha="center", va="center", color=colour, fontsize=9)


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

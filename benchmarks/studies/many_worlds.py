"""Thousands of worlds: steps a second of native batches with MuJoCo Warp on a GPU, beside MuJoCo on the processor.

    python -m benchmarks.studies.many_worlds [--device cuda:0] [--tasks reach lift] [--worlds 64 512 4096] [--minutes 9]

First it is checked that both agree. Of `reach` and `reach-multi` (`UR5SingleStep-v0`, `UR5MultiStep-v0`) the same
actions must get the same verdicts. Of `lift`, `push` and `pick-and-place` scripted episodes must have the same success:
one grasp in `Lift-v0`, of cubes of 15 to 35 mm, 20 to 300 g and friction 0.3 to 1.5, and small steps in the others.
Joints must be within `TOLERANCE` after free moves of reaching and after lifts, and within `OF_SCRIPTS` in all steps
before an object is touched; then the ways of pushed objects differ by millimetres. Next an imitation of the script of
`pick-and-place` is trained in 64 worlds with each of the two, and tried on 100 goals with MuJoCo.

At last steps a second are measured, `lift` in small steps; each figure is of the steps after a first one, which
compiles and fills caches. No measurement begins after so many minutes; what is left out is listed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from benchmarks.studies.tables import head, line
from kinreach._checks import Floats
from kinreach._engines import load_extra
from kinreach._registration import LIFT, MULTI, PICK_AND_PLACE, PUSH, SINGLE
from kinreach._tensors import on_host
from kinreach.baselines import evaluate, get_recipe, train
from kinreach.baselines.inside import PickAndPlaceScript, PushScript
from kinreach.cli import Parser, finish
from kinreach.compare import get_task
from kinreach.errors import InputError

PROG = "python -m benchmarks.studies.many_worlds"
#: How far joints may differ between the two [rad]; Warp computes in single precision. A script answers what it sees,
#: and an object that is put down settles by up to 0.3 mm more in one of them.
TOLERANCE, OF_SCRIPTS = 1e-5, 1e-4
#: An object has been touched when it has moved so far over the table [m].
MOVED = 1e-4
#: Worlds in which the two are compared, and steps that are timed.
COMPARED, STEPS = 64, {SINGLE: 1, MULTI: 3, LIFT: 3, PUSH: 3, PICK_AND_PLACE: 3}
BACKENDS = ("mujoco", "warp")
#: By the names of the command.
TASKS = {"reach": SINGLE, "reach-multi": MULTI, "lift": LIFT, "push": PUSH, "pick-and-place": PICK_AND_PLACE}
SMALL_STEPS: dict[str, dict[str, Any]] = {LIFT: {"steps": "multi"}}
GRASPS: dict[str, Any] = {
    "shapes": ("cube",),
    "sizes": (0.015, 0.035),
    "masses": (0.02, 0.3),
    "frictions": (0.3, 1.5),
}
SCRIPTS: dict[str, Any] = {PUSH: PushScript, PICK_AND_PLACE: PickAndPlaceScript}
#: What is trained, for how many actions, and goals on which it is tried.
RECIPE, ACTIONS, GOALS = "imitated-pick-and-place", 192_000, 100


class Played(NamedTuple):
    """What became of some worlds in a number of steps.

    Attributes:
        verdicts: 0 for success, shape (count,).
        q: Postures after each step [rad], shape (steps, count, n).
        free: Whether these are to be equal, shape (steps, count).
        ends: Where the objects were at last [m], shape (count, 3); NaN without objects.
    """

    verdicts: np.ndarray
    q: np.ndarray
    free: np.ndarray
    ends: np.ndarray


def batch(name: str, count: int, backend: str, device: str | None, threads: int, **options: Any) -> Any:
    """Make a native batch, on the device with Warp."""
    options |= {"device": device} if backend == "warp" else {}
    return gym.make_vec(
        name, count, vectorization_mode="vector_entry_point", backend=backend, threads=threads, **options
    )


def actions(name: str, env: Any, steps: int) -> Iterator[np.ndarray]:
    """Small random actions: in the single step they are postures within 0.2 rad of the start."""
    rng = np.random.default_rng(0)
    start, half = (env.unwrapped.task.home / np.pi, np.pi) if name == SINGLE else (0.0, 1.0)
    for _ in range(steps):
        yield start + rng.uniform(-0.2, 0.2, env.action_space.shape) / half


def last(info: dict[str, Any], name: str) -> np.ndarray:
    """Return an entry of the last step of each world, on the host."""
    value: np.ndarray = on_host(info.get("final_info", info)[name])
    return value


def reached(name: str, count: int, backend: str, device: str, threads: int) -> Played:
    """Act once in each world, at random."""
    env = batch(name, count, backend, device, threads)
    env.reset(seed=0)
    (action,) = actions(name, env, 1)
    info = env.step(action)[4]
    env.close()
    verdicts = last(info, "impossible_code")
    return Played(verdicts, last(info, "q")[None], (verdicts == 0)[None], np.full((count, 3), np.nan))


def grasps(env: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Return what grasps with the arm's closed form, by rows of observations."""
    policy = get_task("lift").methods["closed-form"].make(env)
    return lambda rows: np.array([policy.act(row) for row in rows])


def scripted(name: str, count: int, backend: str, device: str, threads: int) -> Played:
    """Play one scripted episode in each world."""
    options = GRASPS if name == LIFT else {}
    alone = gym.make(name, **options)
    act = grasps(alone) if name == LIFT else SCRIPTS[name](alone).act
    env = batch(name, count, backend, device, threads, **options)
    observations, info = env.reset(seed=0)
    start, going, succeeded = on_host(info["position"]), np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    ends, postures, free = start.copy(), [], []
    while going.any():
        observations, _, terminated, truncated, info = env.step(act(on_host(observations)))
        success, places, over = last(info, "is_success"), last(info, "position"), on_host(terminated | truncated)
        succeeded |= going & success
        ends[going] = places[going]
        postures.append(last(info, "q"))
        lies = np.linalg.norm((places - start)[:, :2], axis=1) < MOVED
        free.append(going & (success if name == LIFT else lies & ~last(info, "gripped")))
        going &= ~over
    env.close()
    alone.close()
    return Played((~succeeded).astype(int), np.array(postures), np.array(free), ends)


def agreement(name: str, count: int, device: str, threads: int) -> tuple[int, int, float, float]:
    """Return in how many worlds the verdicts are equal, and how many succeed with both.

    Then come the largest differences of the joints where they are to be equal [rad], and of where the objects are at
    last [mm], of worlds with equal verdicts; NaN without objects.
    """
    play = reached if name in (SINGLE, MULTI) else scripted
    ours, theirs = (play(name, count, backend, device, threads) for backend in BACKENDS)
    equal, steps = ours.verdicts == theirs.verdicts, min(len(ours.q), len(theirs.q))
    free = ours.free[:steps] & theirs.free[:steps]
    free[:-1] &= free[1:]  # in its last one the object may be touched already
    joints: Floats = np.abs(ours.q[:steps] - theirs.q[:steps])[free]
    objects = 1e3 * np.linalg.norm(ours.ends - theirs.ends, axis=1)[equal]
    both = equal & (ours.verdicts == 0)
    return int(equal.sum()), int(both.sum()), float(joints.max(initial=0.0)), float(objects.max(initial=0.0))


def trained(backend: str, steps: int) -> str:
    """Train the recipe; return which part of goals its policy reaches with MuJoCo, and how long the training took."""
    recipe = replace(get_recipe(RECIPE), options={"backend": backend})
    with TemporaryDirectory() as folder:
        run = train(recipe, Path(folder) / "run", steps=steps)
    return f"{100.0 * evaluate(run.policy, goals=GOALS).reached.mean():.0f} after {run.seconds:.0f} s"


def rate(name: str, count: int, backend: str, device: str | None, threads: int) -> str:
    """Return steps a second of all worlds together."""
    env = batch(name, count, backend, device, threads, **SMALL_STEPS.get(name, {}))
    try:
        env.reset(seed=0)
        first, *timed = actions(name, env, 1 + STEPS[name])
        env.step(first)
        began = time.perf_counter()
        for action in timed:
            env.step(action)
        steps = count * len(timed) / (time.perf_counter() - began)
        return f"{steps:.0f}" if steps >= 10 else f"{steps:.2f}"
    finally:
        env.close()


def card(device: str) -> str:
    """Make a device of Warp the one that is used, and return its name."""
    warp: Any = load_extra("warp", "warp")
    warp.init()
    try:
        warp.set_device(device)
    except (ValueError, RuntimeError) as error:
        raise InputError(f"there is no device {device!r}: {error}; --device cpu tries the script") from None
    return str(warp.get_device().name)


class Clock:
    """The time that is left.

    Attributes:
        late: What was not measured.
    """

    def __init__(self, minutes: float) -> None:
        self._end = time.monotonic() + 60 * minutes
        self.late: list[str] = []

    def found(self, what: str, measure: Callable[[], str]) -> str:
        """Measure, unless it is too late."""
        if time.monotonic() < self._end:
            return measure()
        self.late.append(what)
        return "not measured"


def main(argv: list[str] | None = None) -> int:
    """Compare the two, train, then measure from few worlds to many."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0", help="of Warp (default: %(default)s)")
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS), help="some (default: all)")
    parser.add_argument("--worlds", type=int, nargs="+", default=[64, 512, 4096, 8192], metavar="N")
    parser.add_argument(
        "--training",
        type=int,
        default=ACTIONS,
        metavar="N",
        help="actions of the training, where pick-and-place is among the tasks; 0: none (default: %(default)s)",
    )
    parser.add_argument("--threads", type=int, default=1, help="of MuJoCo on the processor (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=9.0, help="no measurement begins later (default: %(default)s)")
    arguments = parser.parse_args(argv)
    device, threads, names = arguments.device, arguments.threads, [TASKS[task] for task in arguments.tasks]
    print(f"{card(device)}, {threads} threads of MuJoCo\n")
    clock, wrong, count = Clock(arguments.minutes), False, min(COMPARED, *arguments.worlds)
    print(head("agreement", "worlds", "equal verdicts", "both succeed", "joints apart, rad", "objects apart, mm"))
    for name in names:
        equal, both, joints, objects = agreement(name, count, device, threads)
        ends = "-" if np.isnan(objects) else f"{objects:.1e}"
        print(line(name, count, equal, both, f"{joints:.1e}", ends), flush=True)
        wrong |= equal < count or joints > (OF_SCRIPTS if name in SCRIPTS else TOLERANCE)
    if PICK_AND_PLACE in names and arguments.training:
        print("\n" + head("training", "actions", "goals reached with MuJoCo, %"))
        for backend in BACKENDS:
            goals = clock.found(f"training, {backend}", partial(trained, backend, arguments.training))
            print(line(f"{RECIPE}, {backend}", arguments.training, goals), flush=True)
    print("\n" + head("steps/s", "worlds", "MuJoCo", "Warp"))
    for worlds in sorted(arguments.worlds):
        for name in names:
            found = [
                clock.found(
                    f"{name} with {worlds} worlds, {backend}", partial(rate, name, worlds, backend, device, threads)
                )
                for backend in BACKENDS
            ]
            print(line(name, worlds, *found), flush=True)
    print("".join(f"\nout of time: {each}" for each in clock.late))
    print(f"agreement, joints within {TOLERANCE:g} rad, with scripts {OF_SCRIPTS:g}: {'no' if wrong else 'yes'}")
    return int(wrong)


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

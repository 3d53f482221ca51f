"""Thousands of worlds: steps a second of native batches with MuJoCo Warp on a GPU, beside MuJoCo on the processor.

    python -m benchmarks.studies.many_worlds [--device cuda:0] [--worlds 64 512 4096 8192] [--minutes 9]

Reaching in one move (`UR5SingleStep-v0`) and in small steps (`UR5MultiStep-v0`) runs with both; lifting (`Lift-v0` in
small steps) with MuJoCo alone, because Warp's worlds share one model, and objects differ. Each figure is of the steps
after a first one, which compiles and fills caches. Before them it is checked that both agree on the same actions: the
same verdicts, and postures of free moves within `TOLERANCE`. No measurement begins after so many minutes; what is left
out is listed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.studies.tables import head, line
from kinreach._engines import load_extra
from kinreach._registration import LIFT, MULTI, SINGLE
from kinreach.cli import Parser, finish
from kinreach.errors import InputError

PROG = "python -m benchmarks.studies.many_worlds"
#: How far postures of free moves may differ between the two [rad]; Warp computes in single precision.
TOLERANCE = 1e-5
#: Worlds in which the two are compared, and steps that are timed.
COMPARED, STEPS = 64, {SINGLE: 1, MULTI: 3, LIFT: 3}
TASKS: dict[str, dict[str, Any]] = {SINGLE: {}, MULTI: {}, LIFT: {"steps": "multi"}}


def batch(name: str, count: int, backend: str, device: str | None, threads: int) -> Any:
    """Make a native batch, on the device with Warp."""
    options: dict[str, Any] = {"backend": backend, "threads": threads, **TASKS[name]}
    options |= {"device": device} if backend == "warp" else {}
    return gym.make_vec(name, count, vectorization_mode="vector_entry_point", **options)


def actions(name: str, env: Any, steps: int) -> Iterator[np.ndarray]:
    """Small random actions: in the single step they are postures within 0.2 rad of the start."""
    rng = np.random.default_rng(0)
    start, half = (env.unwrapped.task.home / np.pi, np.pi) if name == SINGLE else (0.0, 1.0)
    for _ in range(steps):
        yield start + rng.uniform(-0.2, 0.2, env.action_space.shape) / half


def last(info: dict[str, Any], name: str) -> np.ndarray:
    """Return an entry of the last step of each world, on the host."""
    value = info.get("final_info", info)[name]
    return np.asarray(value.cpu() if hasattr(value, "cpu") else value)


def agreement(name: str, count: int, device: str, threads: int) -> tuple[int, float]:
    """Return in how many worlds the verdicts are equal, and the largest difference of a free move [rad]."""
    told = []
    for backend in ("mujoco", "warp"):
        env = batch(name, count, backend, device, threads)
        env.reset(seed=0)
        (action,) = actions(name, env, 1)
        info = env.step(action)[4]
        told.append((last(info, "impossible_code"), last(info, "q")))
        env.close()
    (verdicts, ours), (others, theirs) = told
    free = (verdicts == 0) & (others == 0)
    return int((verdicts == others).sum()), float(np.abs(ours - theirs)[free].max(initial=0.0))


def rate(name: str, count: int, backend: str, device: str | None, threads: int) -> float:
    """Return steps a second of all worlds together."""
    env = batch(name, count, backend, device, threads)
    try:
        env.reset(seed=0)
        first, *timed = actions(name, env, 1 + STEPS[name])
        env.step(first)
        began = time.perf_counter()
        for action in timed:
            env.step(action)
        return count * len(timed) / (time.perf_counter() - began)
    finally:
        env.close()


def card(device: str) -> str:
    """Return the name of a device of Warp."""
    warp: Any = load_extra("warp", "warp")
    warp.init()
    try:
        return str(warp.get_device(device).name)
    except (ValueError, RuntimeError) as error:
        raise InputError(f"there is no device {device!r}: {error}; --device cpu tries the script") from None


def main(argv: list[str] | None = None) -> int:
    """Compare the two, then measure from few worlds to many."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0", help="of Warp (default: %(default)s)")
    parser.add_argument("--worlds", type=int, nargs="+", default=[64, 512, 4096, 8192], metavar="N")
    parser.add_argument("--threads", type=int, default=1, help="of MuJoCo on the processor (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=9.0, help="no measurement begins later (default: %(default)s)")
    arguments = parser.parse_args(argv)
    began, late, wrong = time.monotonic(), [], False
    print(f"{card(arguments.device)}, {arguments.threads} threads of MuJoCo\n")
    count = min(COMPARED, *arguments.worlds)
    print(head("agreement", "worlds", "equal verdicts", "free moves apart, rad"))
    for name in (SINGLE, MULTI):
        equal, apart = agreement(name, count, arguments.device, arguments.threads)
        print(line(name, count, equal, f"{apart:.1e}"), flush=True)
        wrong |= equal < count or apart > TOLERANCE
    print("\n" + head("steps/s", "worlds", "MuJoCo", "Warp"))
    for worlds in sorted(arguments.worlds):
        for name in TASKS:
            found = []
            for backend in ("mujoco", "warp"):
                if backend == "warp" and name == LIFT:
                    found.append("-")
                elif time.monotonic() - began > 60 * arguments.minutes:
                    late.append(f"{name} with {worlds} worlds, {backend}")
                    found.append("not measured")
                else:
                    steps = rate(name, worlds, backend, arguments.device, arguments.threads)
                    found.append(f"{steps:.0f}" if steps >= 10 else f"{steps:.2f}")
            print(line(name, worlds, *found), flush=True)
    print("".join(f"\nout of time: {each}" for each in late))
    print(f"agreement within {TOLERANCE:g} rad: {'no' if wrong else 'yes'}")
    return int(wrong)


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

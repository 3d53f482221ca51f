"""Long runs: memory stays flat, handles and threads too, and two runs with the same seed are the same to the bit."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import kinreach  # noqa: F401 (registers the environments)
from kinreach._registration import BUTTON, MULTI, SINGLE
from kinreach.sim import ArmSimulation, render
from tools.endurance.outcome import Outcome, demand

#: In how many parts a run is cut; the process is looked at after each.
PARTS = 10
#: Parts in which caches may still fill.
WARM_UP = 2
#: What resident memory may differ by after the warm-up [bytes]: pages that the allocator holds back. It does not grow
#: with the length of a run.
SLACK = 8 * 2**20
#: The same where graphics contexts come and go, and for what a run may hold more than the one before: the software
#: renderer's caches differ by so much from one context to the next, and do not add up. A context that is not given back
#: keeps 116 MiB.
KEPT = 32 * 2**20
#: How many further runs may show that what the first one kept does not grow: under load the renderer's threads cache
#: up to 72 MiB once.
FURTHER = 2
BATCH = 10
SEED = 11


@dataclass(frozen=True)
class Usage:
    """What the process holds: resident memory [bytes], file handles, threads."""

    memory: int
    handles: int
    threads: int

    @classmethod
    def now(cls) -> Usage:
        """Return this process's memory, open files and threads now."""
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return cls(
            pages * os.sysconf("SC_PAGE_SIZE"), len(os.listdir("/proc/self/fd")), len(os.listdir("/proc/self/task"))
        )


def kinematic_steps(steps: int) -> Outcome:
    """Random steps of the multi-step environment without dynamics, in a batch of ten."""
    begin = lambda: _steps(_batch(MULTI, backend="kinematic"))  # noqa: E731
    return _endure(begin, steps // BATCH, "steps", each=BATCH)


def dynamics_steps(steps: int) -> Outcome:
    """Random steps of the multi-step environment with dynamics."""
    return _endure(lambda: _steps(gym.make(MULTI, backend="mujoco")), steps, "steps")


def torque_steps(steps: int) -> Outcome:
    """Random steps of the arm under torque, with the report's own gears, which make it fly about."""
    return _endure(lambda: _steps(gym.make(BUTTON, actuation="report")), steps, "steps")


def camera_resets(resets: int) -> Outcome:
    """Resets of which each draws the pictures of both cameras and finds the ball in them."""
    return _endure(
        lambda: _resets(gym.make(SINGLE, backend="kinematic", observation="camera")),
        resets,
        "resets",
    )


def graphics_contexts(times: int) -> Outcome:
    """Renderers that are opened, used and closed, one after the other."""

    def pictures() -> Iterator[Any]:
        simulation = ArmSimulation("ur5-thesis")
        while True:
            yield render(simulation, "front", width=64, height=36, shadows=False)

    return _endure(pictures, times, "contexts", slack=KEPT)


def _endure(begin: Callable[[], Iterator[Any]], rounds: int, of: str, *, each: int = 1, slack: int = SLACK) -> Outcome:
    """Run something twice with the same seed; again, up to `FURTHER` times, where the second run holds more memory.

    Args:
        begin: Gives an iterator that yields a result per round.
        rounds: Of each of the two runs.
        of: What a round is.
        each: How many of these there are in a round.
        slack: What memory may differ by [bytes].

    Raises:
        BrokenPromiseError: The two differ, or something has grown.
    """
    first, usage = _run(begin, rounds)
    again, more = _run(begin, rounds)
    for part, (one, other) in enumerate(zip(first, again, strict=True)):
        demand(one == other, f"two runs with the same seed differ in part {part + 1} of {PARTS}")
    runs = usage[WARM_UP:], more[WARM_UP:]
    memory = [[u.memory for u in run] for run in runs]
    grown = max(max(run) - min(run) for run in memory)
    demand(
        grown <= slack, f"memory has grown by {grown / 2**20:.1f} MiB: {[[m >> 20 for m in run] for run in memory]} MiB"
    )
    peaks = [max(run) for run in memory]
    while peaks[-1] - peaks[-2] > KEPT and len(peaks) < 2 + FURTHER:
        peaks.append(max(u.memory for u in _run(begin, rounds)[1][WARM_UP:]))
    kept = peaks[-1] - peaks[-2]
    demand(kept <= KEPT, f"every run leaves memory behind, the last {kept / 2**20:.1f} MiB")
    settled = [u for run in runs for u in run]
    for what in ("handles", "threads"):
        held = {getattr(u, what) for u in settled}
        demand(len(held) == 1, f"the number of {what} changes: {sorted(held)}")
    return Outcome(
        2 * rounds * each, of, f"memory within {grown / 2**20:.1f} MiB, {settled[-1].handles} handles, same bits twice"
    )


def _run(begin: Callable[[], Iterator[Any]], rounds: int) -> tuple[list[str], list[Usage]]:
    """The digest of each part, and what the process held after it."""
    demand(rounds >= PARTS, f"at least {PARTS} rounds, not {rounds}")
    results = begin()
    digests, usage = [], []
    for part in range(PARTS):
        digest = hashlib.sha256()
        for _ in range(rounds * (part + 1) // PARTS - rounds * part // PARTS):
            digest.update(np.ascontiguousarray(next(results)).tobytes())
        digests.append(digest.hexdigest())
        usage.append(Usage.now())
    results.close()  # type: ignore[attr-defined]
    return digests, usage


def _batch(name: str, **options: Any) -> Any:
    return gym.make_vec(name, num_envs=BATCH, vectorization_mode="vector_entry_point", **options)


def _steps(env: Any) -> Iterator[Any]:
    """Endless random steps; each yields observation and reward."""
    try:
        env.action_space.seed(SEED)
        env.reset(seed=SEED)
        alone = not hasattr(env, "num_envs")
        while True:
            observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            yield np.append(observation, reward)
            if alone and (terminated or truncated):
                env.reset()
    finally:
        env.close()


def _resets(env: Any) -> Iterator[Any]:
    """Endless resets; each yields the observation."""
    try:
        yield env.reset(seed=SEED)[0]
        while True:
            yield env.reset()[0]
    finally:
        env.close()

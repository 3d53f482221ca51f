"""Threads and processes: each with its own instance finds what a single one finds; a process that dies is reported."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import cloudpickle
import gymnasium as gym
import numpy as np
import torch  # noqa: F401 (processes are forked from one that has it, as in training)
from gymnasium.vector.async_vector_env import AsyncState

from kinreach._registration import MULTI
from tools.endurance.jobs import JOBS, SHARED, UNPICKLED
from tools.endurance.outcome import Outcome, demand

THREADS = 8
#: A worker that takes longer hangs [s].
PATIENCE = 120.0


def bits(values: Sequence[Any]) -> bytes:
    """All numbers, one after the other."""
    return b"".join(np.ascontiguousarray(value, dtype=np.float64).tobytes() for value in values)


def in_threads(rounds: int, *, jobs: Sequence[str] = tuple(JOBS)) -> Outcome:
    """Eight threads at a time do the same, each with its own instance; what may be shared is shared as well.

    Raises:
        BrokenPromiseError: A thread finds something else than a single one, or fails.
    """
    runs = 0
    for name in jobs:
        make, do = JOBS[name]
        expected, common = bits(do(make())), make()
        makers = [make, lambda common=common: common] if name in SHARED else [make]
        for _ in range(rounds):
            for maker in makers:
                for found in _together(lambda maker=maker, do=do: bits(do(maker()))):
                    demand(found == expected, f"{name} in a thread: {_shown(found)}")
                    runs += 1
    return Outcome(runs, "runs in threads", f"{THREADS} threads, {len(jobs)} kinds of job, the same bits")


def _together(do: Callable[[], bytes]) -> list[bytes | Exception]:
    """What as many threads find that begin at the same moment."""
    found: list[bytes | Exception] = []
    gate = threading.Barrier(THREADS)

    def body() -> None:
        gate.wait()
        try:
            found.append(do())
        except Exception as error:
            found.append(error)

    threads = [threading.Thread(target=body) for _ in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
    demand(not any(thread.is_alive() for thread in threads), "a thread hangs")
    return found


def _shown(found: bytes | Exception | str) -> str:
    return "other bits" if isinstance(found, bytes) else str(found)


def in_processes(methods: Sequence[str] = ("fork", "spawn"), *, jobs: Sequence[str] = tuple(JOBS)) -> Outcome:
    """Worker processes, started in several ways, make an instance each, or are sent a pickled one.

    Raises:
        BrokenPromiseError: A process finds something else than this one, fails, or hangs.
    """
    runs = 0
    expected = {name: bits(JOBS[name][1](JOBS[name][0]())) for name in jobs}
    sent: list[tuple[str, bytes | None]] = [(name, None) for name in jobs]
    for name in jobs:
        if name not in UNPICKLED:
            instance = JOBS[name][0]()
            JOBS[name][1](instance)  # used instances are sent, too
            sent += [(name, pickle.dumps(instance)), (name, cloudpickle.dumps(instance))]
    for method in methods:
        for name, found in zip([name for name, _ in sent], _answers(method, sent), strict=True):
            demand(found == expected[name], f"{name} in a process ({method}): {_shown(found)}")
            runs += 1
    return Outcome(
        runs, "runs in processes", f"{', '.join(methods)}; {len(sent) - len(jobs)} of {len(sent)} sent pickled"
    )


def _answers(method: str, sent: list[tuple[str, bytes | None]]) -> list[Any]:
    context = multiprocessing.get_context(method)
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, sent))
    process.start()
    theirs.close()
    answers = []
    for name, _ in sent:
        demand(ours.poll(PATIENCE), f"{name} hangs in a process ({method})")
        answers.append(ours.recv())
    process.join(PATIENCE)
    demand(process.exitcode == 0, f"a process ({method}) ends with {process.exitcode}")
    return answers


def _work(pipe: Any, sent: list[tuple[str, bytes | None]]) -> None:
    """In the worker: answer each job with its bits, or with what went wrong."""
    for name, pickled in sent:
        make, do = JOBS[name]
        try:
            pipe.send(bits(do(make() if pickled is None else pickle.loads(pickled))))
        except Exception as error:
            pipe.send(f"{type(error).__name__}: {error}")


def killed_worker(times: int, *, name: str = MULTI, **options: Any) -> Outcome:
    """Kill a worker of Gymnasium's `AsyncVectorEnv`: the next step says so, and closing ends all processes.

    Raises:
        BrokenPromiseError: Nothing is said, or it takes too long.
    """
    rng = np.random.default_rng(0)
    longest = 0.0
    for _ in range(times):
        env: Any = gym.make_vec(name, num_envs=3, vectorization_mode="async", **options)
        env.reset(seed=0)
        for _ in range(int(rng.integers(0, 5))):
            env.step(env.action_space.sample())
        processes = list(env.processes)
        os.kill(processes[int(rng.integers(0, 3))].pid, signal.SIGKILL)
        began = time.perf_counter()
        said = _said(env)
        env._state = AsyncState.DEFAULT  # else Gymnasium waits for the dead one first, and raises once more
        env.close(terminate=True)
        for process in processes:
            process.join(PATIENCE)
            demand(process.exitcode is not None, "a worker outlives its environment")
        longest = max(longest, time.perf_counter() - began)
        demand(isinstance(said, EOFError | BrokenPipeError | ConnectionError), f"a dead worker is reported as {said!r}")
    demand(longest < PATIENCE, f"a dead worker is noticed after {longest:.0f} s")
    return Outcome(times, "workers killed", f"noticed and closed within {longest:.1f} s")


def _said(env: Any) -> BaseException | None:
    """What stepping raises within a few steps: the worker may have answered the first one before it died."""
    for _ in range(3):
        try:
            env.step(env.action_space.sample())
        except Exception as error:
            return error
    return None

"""Steps and episodes per second of the environments, beside PandaReach-v3 and Reacher-v5; resets that take pictures."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv

from benchmarks.speed.measure import Contender, Timings, interleaved
from benchmarks.speed.peers.gym_child import play, random_actions
from benchmarks.speed.peers.gym_peer import FETCH, FETCH_PICK, PANDA, PANDA_PICK, PANDA_PUSH, REACHER, gym_peers
from benchmarks.speed.sections import Chart, Options, Progress, Section, Target
from benchmarks.speed.suites import PROFILED, episodes
from benchmarks.speed.tables import median_rates, median_ratio, rate_row, samples, short_of_cores, time_row
from kinreach._registration import BUTTON, MULTI, OBSTACLES, PICK_AND_PLACE, PUSH, SINGLE
from kinreach.errors import DrawingError, InstallationError

AGAIN = "python -m benchmarks.speed --suite env"
#: Environments of a kinematic batch, and how many times as fast as PandaReach-v3 it has to be.
KINEMATIC, TIMES_PANDA = 4096, 50.0
#: Steps of peers in a round.
PEER_STEPS = {PANDA: 300, PANDA_PUSH: 300, PANDA_PICK: 300, FETCH: 300, FETCH_PICK: 300, REACHER: 6000}
#: Longest reset with a camera observation [ms].
RESET_MS = 60.0


@dataclass(frozen=True)
class Amounts:
    """How much of everything a round takes.

    Attributes:
        share: Of the steps that are written down with the contenders.
        dynamic: Simulations in a batch with dynamics.
        resets: Of each kind.
    """

    share: float
    dynamic: int
    resets: int


FULL, QUICK = Amounts(1.0, 256, 8), Amounts(0.1, 32, 2)
COLUMNS = ("environment", "steps/s, median", "steps/s, worst round", "x PandaReach-v3", "x Reacher-v5", "cores")

STEPS_TEXT = f"""\
Random actions, drawn before the clock runs; resets of ended episodes count as part of the steps. A batch is one
`gym.make_vec(..., vectorization_mode="vector_entry_point")`. Peers run in a process of their own, as `gym.make` gives
them, and take turns with the others. The tasks differ: a step of PandaReach-v3 is 40 ms of a position-controlled arm
in PyBullet, and one of Reacher-v5 20 ms of a planar arm with two joints. A step of Push-v0 and PickAndPlace-v0 is 40 ms
of an arm with servos. One of UR5SingleStep-v0 under dynamics is a whole episode, 1.3 s and more of simulated time.

A kinematic step judges the collisions of its target, which is most of a batch's time. {PROFILED}, by `cProfile` and
`perf record`: under dynamics 90 % of
a batch's time was MuJoCo's step, the rest the Python that checks whether joints have arrived. The section on episodes
explains why random actions take longer than those that reach. The button's batch was MuJoCo's step to 97 %."""

RESET_TEXT = f"""\
`reset()` of one environment with the dynamics. With `observation="camera"` two cameras draw a colour and a depth
picture of 640 x 360 pixels each, and the ball is found in them. Without a graphics card OpenGL draws in software.
{PROFILED}, by `cProfile`: nine tenths of the time were drawing and fetching the pictures, a twentieth was finding the
ball."""


def run(options: Options, progress: Progress) -> list[Section]:
    """Measure (`benchmarks.speed.suites.Run`)."""
    return [_steps(options, progress), episodes.section(options, progress, AGAIN), _resets(options, progress)]


def _steps(options: Options, progress: Progress) -> Section:
    amounts = QUICK if options.quick else FULL
    kinematic = {task: f"{task.removeprefix('kinreach/')}, kinematic, batch of {KINEMATIC}" for task in (SINGLE, MULTI)}
    missing: dict[str, str] = {}
    with ExitStack() as opened:
        contenders = _contenders(opened, amounts, options.seed, kinematic, missing)
        peers, absent = opened.enter_context(gym_peers(list(PEER_STEPS), seed=options.seed))
        planned = {peer.name: steps for peer, steps in PEER_STEPS.items()}
        for name, peer in peers.items():
            steps = _at_least_one(amounts.share * planned[name])
            contenders.append(Contender(name, partial(peer.play, steps), steps, note=peer.description, peer=True))
        timings = interleaved(
            contenders, options.rounds, on_round=lambda done, rounds: progress("steps of environments", done, rounds)
        )
    notes = {contender.name: contender.note for contender in contenders if contender.name in timings}
    rows = [
        rate_row(name, timings, (PANDA.name, REACHER.name), note="its own process" if notes[name] else "")
        for name in timings
    ]
    versions = "; ".join(f"{name}: {note}" for name, note in notes.items() if note)
    return Section(
        title="Environments: steps per second",
        text=STEPS_TEXT + (f"\n\nPeers: {versions}." if versions else ""),
        columns=COLUMNS,
        rows=rows,
        again=AGAIN,
        targets=_times_panda(timings, kinematic),
        missing=missing | absent | timings.failed,
        charts=[
            Chart(
                "steps per second",
                bars=median_rates(timings),
                x="steps/s",
                peers=[peer.name for peer in PEER_STEPS],
            )
        ],
        samples=samples(timings),
    )


def _contenders(
    opened: ExitStack, amounts: Amounts, seed: int, kinematic: dict[str, str], missing: dict[str, str]
) -> list[Contender]:
    """All of ours, their environments left open until `opened` closes."""
    share, dynamic = amounts.share, amounts.dynamic
    batch, single = partial(_batch, opened, seed), partial(_single, opened, seed)
    contenders = [
        batch(kinematic[SINGLE], SINGLE, KINEMATIC, share * 50, backend="kinematic"),
        batch(kinematic[MULTI], MULTI, KINEMATIC, share * 50, backend="kinematic"),
        *_learners_batch(opened, seed, share * 50, missing),
        single("UR5SingleStep-v0, kinematic, one", SINGLE, share * 500, backend="kinematic"),
        single("UR5MultiStep-v0, kinematic, one", MULTI, share * 500, backend="kinematic"),
    ]
    for name, task, steps in (("UR5SingleStep-v0, mujoco", SINGLE, 1), ("ButtonPress-v0", BUTTON, share * 20)):
        for threads, written in ((1, "1 thread"), (2, "2 threads")):
            name_of_batch = f"{name}, batch of {dynamic}, {written}"
            contenders.append(batch(name_of_batch, task, dynamic, steps, threads=threads))
    return [
        *contenders,
        single("UR5SingleStep-v0, mujoco, one", SINGLE, share * 60),
        single("UR5MultiStep-v0, mujoco, one", MULTI, share * 300),
        single("ButtonPress-v0, one", BUTTON, share * 1000),
        single("Obstacles-v0, one", OBSTACLES, share * 100),
        single("Push-v0, one", PUSH, share * 300),
        single("PickAndPlace-v0, one", PICK_AND_PLACE, share * 300),
        batch("PickAndPlace-v0, batch of 64, 2 threads", PICK_AND_PLACE, 64, share * 10, threads=2),
    ]


def _times_panda(timings: Timings, kinematic: dict[str, str]) -> list[Target]:
    if PANDA.name not in timings:
        return []
    return [
        Target(
            what=name,
            bound=TIMES_PANDA,
            kind="at least",
            measured=median_ratio(timings, PANDA.name, name),
            unit="x steps/s of PandaReach-v3",
        )
        for name in kinematic.values()
    ]


def _batch(opened: ExitStack, seed: int, name: str, task: str, count: int, steps: float, **settings: Any) -> Contender:
    """A native batch; one call is some steps of all its environments."""
    env = gym.make_vec(task, num_envs=count, vectorization_mode="vector_entry_point", **settings)
    opened.enter_context(closing(env))
    env.reset(seed=seed)
    return _stepped(name, env.step, env, count, steps, seed)


def _learners_batch(opened: ExitStack, seed: int, steps: float, missing: dict[str, str]) -> list[Contender]:
    """A native batch as stable-baselines3 sees it."""
    try:
        from kinreach.baselines._vec_envs import SB3VecEnv
    except ImportError as error:
        missing["stable-baselines3"] = f"the batch behind its interface is left out: {error}"
        return []
    env = gym.make_vec(MULTI, num_envs=KINEMATIC, vectorization_mode="vector_entry_point", backend="kinematic")
    learners = opened.enter_context(closing(SB3VecEnv(env)))
    learners.seed(seed)
    learners.reset()
    name = f"UR5MultiStep-v0, kinematic, batch of {KINEMATIC} as SB3VecEnv"
    return [_stepped(name, learners.step, env, KINEMATIC, steps, seed)]


def _stepped(
    name: str, step: Callable[[Any], object], env: VectorEnv[Any, Any, Any], count: int, steps: float, seed: int
) -> Contender:
    env.action_space.seed(seed)
    actions = cycle([env.action_space.sample() for _ in range(16)])
    calls = _at_least_one(steps)

    def run() -> None:
        for _ in range(calls):
            step(next(actions))

    return Contender(name, run, calls * count)


def _single(opened: ExitStack, seed: int, name: str, task: str, steps: float, **settings: Any) -> Contender:
    env = opened.enter_context(closing(gym.make(task, **settings)))
    env.reset(seed=seed)
    calls = _at_least_one(steps)
    return Contender(name, partial(play, env, random_actions(env, seed), calls), calls)


def _at_least_one(steps: float) -> int:
    return max(1, int(steps))


def _resets(options: Options, progress: Progress) -> Section:
    settings: dict[str, dict[str, Any]] = {
        'observation="camera"': {"observation": "camera"},
        'observation="camera", the thesis\'s pipeline': {"observation": "camera", "pipeline": "thesis"},
        'observation="geometric"': {},
    }
    resets = (QUICK if options.quick else FULL).resets
    missing: dict[str, str] = {}
    contenders = []
    with ExitStack() as opened:
        for name, chosen in settings.items():
            env = opened.enter_context(closing(gym.make(SINGLE, **chosen)))
            try:
                env.reset(seed=options.seed)
            except (DrawingError, InstallationError) as error:
                missing[name] = str(error)
                continue
            contenders.append(Contender(name, partial(_reset, env, resets), resets))
        timings = interleaved(
            contenders, options.rounds, on_round=lambda done, rounds: progress("resets", done, rounds)
        )
    rows = [time_row(name, timings, 1e-3) for name in timings]
    camera = next(iter(settings))
    targets = []
    if camera in timings:
        median = float(1e3 * np.median(timings[camera]))
        why = short_of_cores(timings, camera, 1)
        targets.append(Target("reset with a camera observation", RESET_MS, "at most", median, "ms", why))
    return Section(
        title="Environments: resets",
        text=RESET_TEXT,
        columns=("UR5SingleStep-v0", "reset, median [ms]", "worst round [ms]", "cores"),
        rows=rows,
        again=AGAIN,
        targets=targets,
        missing=missing,
        samples=samples(timings),
    )


def _reset(env: gym.Env[Any, Any], count: int) -> None:
    for _ in range(count):
        env.reset()

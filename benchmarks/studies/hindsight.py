"""SAC with hindsight experience replay on goal environments: learning curves, beside panda-gym's PandaReach.

    pip install panda-gym  # or kinreach[bench]
    python -m benchmarks.studies.hindsight --figure docs/images/hindsight.png
    python -m benchmarks.studies.hindsight --only push --figure docs/images/hindsight_push.png

Rewards are sparse; the learner and the scaling of observations are the same everywhere, and so are its settings while
reaching. There actions move the tip by up to 5 cm along each axis, as PandaReach's do; `--only joints` turns joints
instead. Pushing begins with the tip above the middle of the table, and an object is at its goal within 5 cm, both as in
PandaPush; settings are rl-baselines3-zoo's for it with smaller networks and batches, and fewer updates.

Each seed has a folder with `curve.csv` (actions, reached of the test's goals in percent, median distance at the end of
an episode, processor time), and what the training goes on from: the command begun again skips what is done. At the end
it prints a table and draws the curves.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize

import kinreach  # noqa: F401 (registers the environments)
from benchmarks.studies.reached_curves import draw, numbers_of, rows_of, write_rows
from benchmarks.studies.tables import head, line, spread
from kinreach._checks import check_count
from kinreach._engines import load_extra
from kinreach._files import make_writable
from kinreach.baselines import SB3VecEnv
from kinreach.cli import Parser, finish
from kinreach.envs.inside import lift_task
from kinreach.kinematics import ArmKinematics
from kinreach.plots._colours import own_colour
from kinreach.robots import THESIS_ARM, ArmDescription

PROG = "python -m benchmarks.studies.hindsight"
NUM_ENVS, TEST_GOALS, TEST_SEED = 8, 50, 10_000
#: Of an episode: while reaching, and while pushing.
MOST_STEPS, MOST_PUSHING = 25, 60
#: Where pushes begin, 10 cm above the middle of the table [m].
START = (0.475, 0.0, -0.1)
#: Chosen on seed 100; eight updates to eight actions.
SETTINGS: Mapping[str, Any] = {
    "batch_size": 128,
    "gamma": 0.9,
    "tau": 0.05,
    "learning_rate": 1e-3,
    "learning_starts": 1_000,
    "gradient_steps": 8,
    "buffer_size": 100_000,
    "policy_kwargs": {"net_arch": [64, 64]},
}

#: As rl-baselines3-zoo has them for PandaPush, where networks have three layers of 512, batches 2048 transitions, and
#: every action an update; here two updates to eight actions.
PUSHING: Mapping[str, Any] = {
    "batch_size": 512,
    "gamma": 0.95,
    "gradient_steps": 2,
    "policy_kwargs": {"net_arch": [128, 128], "n_critics": 2},
}


@dataclass(frozen=True)
class Contender:
    """What is learned.

    Attributes:
        title: In table and figure.
        criterion: When a goal is reached.
        batch: Makes a number of environments.
        verb: In the figure's title.
        settings: Other ones than `SETTINGS`.
        steps, every: Actions of a training, and between two tests.
    """

    title: str
    criterion: str
    batch: Callable[[int], VecEnv]
    verb: str = "Reaching"
    settings: Mapping[str, Any] = field(default_factory=dict)
    steps: int = 6_000
    every: int = 1_000


def of_kinreach(count: int, **options: Any) -> VecEnv:
    """Return a native batch of a goal environment with sparse rewards."""
    options |= {"goal_env": True, "reward": "sparse", "max_episode_steps": MOST_STEPS, "backend": "kinematic"}
    return SB3VecEnv(gym.make_vec("kinreach/Reach-v0", count, "vector_entry_point", steps="multi", **options))


def of_panda_gym(count: int) -> VecEnv:
    """Return PandaReach, whose rewards are sparse, in one process."""
    load_extra("panda_gym", "bench")
    return DummyVecEnv([lambda: gym.make("PandaReach-v3", max_episode_steps=MOST_STEPS)] * count)


def low_arm() -> ArmDescription:
    """Return the arm of the tabletop tasks, which starts with the tip above the middle of the table."""
    arm = lift_task.grasping_arm(THESIS_ARM)
    kinematics: Any = ArmKinematics.of(arm, base="world")
    home = np.array(arm.home)
    T = kinematics.fk(home)
    T[:3, 3] = START
    return replace(arm, home=tuple(kinematics.nearest(T, home).q.tolist()))


def of_tabletop(name: str, count: int) -> VecEnv:
    """Return a native batch of a task with an object, with sparse rewards."""
    options: dict[str, Any] = {"goal_env": True, "reward": "sparse", "control": "position", "within": 0.05}
    batch = gym.make_vec(name, count, "vector_entry_point", arm=low_arm(), max_episode_steps=MOST_PUSHING, **options)
    return SB3VecEnv(batch)


CONTENDERS = {
    "panda": Contender("PandaReach, position", "5 cm", of_panda_gym),
    "position": Contender("Reach-v0, position", "1 cm, 0.15 rad", partial(of_kinreach, control="position")),
    "joints": Contender("Reach-v0, joints", "1 cm, 0.15 rad", of_kinreach),
    "push": Contender(
        "Push-v0, position",
        "5 cm",
        partial(of_tabletop, "kinreach/Push-v0"),
        verb="Pushing",
        settings=PUSHING,
        steps=60_000,
        every=10_000,
    ),
}
#: Those with like actions.
ALIKE = ["panda", "position"]


def learner(env: VecEnv, seed: int, settings: Mapping[str, Any]) -> SAC:
    """Return an untrained learner."""
    replay = {"n_sampled_goal": 4, "goal_selection_strategy": "future"}
    return SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs=replay,
        seed=seed,
        **{**SETTINGS, **settings},
    )


def tested(model: SAC, env: VecNormalize) -> tuple[float, float]:
    """Return the share of the test's goals that are reached [%], and the median distance at the end [mm]."""
    env.seed(TEST_SEED)
    seen: Any = env.reset()
    ended, reached, distance = np.zeros(env.num_envs, bool), np.zeros(env.num_envs, bool), np.zeros(env.num_envs)
    while not ended.all():
        seen, _, done, infos = env.step(model.predict(seen, deterministic=True)[0])
        for index in np.flatnonzero(done & ~ended):
            last: Any = env.unnormalize_obs(infos[index]["terminal_observation"])
            reached[index] = infos[index]["is_success"]
            distance[index] = np.linalg.norm((last["achieved_goal"] - last["desired_goal"])[:3])
        ended |= done
    return 100 * float(reached.mean()), 1000 * float(np.median(distance))


def train(contender: Contender, folder: Path, seed: int, steps: int | None, every: int | None) -> None:
    """Train one seed, or go on with it, and write its curve; without numbers those of the contender."""
    steps, every = steps or contender.steps, every or contender.every
    make_writable(folder)
    curve, saved, buffer, scales = (folder / name for name in ("curve.csv", "model.zip", "buffer.pkl", "scales.pkl"))
    rows = rows_of(curve)  # written last
    if len(rows) > 1 and int(rows[-1][0]) >= steps:
        return
    env, test = (VecNormalize(contender.batch(count), norm_reward=False) for count in (NUM_ENVS, TEST_GOALS))
    test.training = False
    if len(rows) > 1:
        env = VecNormalize.load(str(scales), env.venv)
        model = SAC.load(saved, env=env)
        with warnings.catch_warnings():  # episodes that were under way are cut off, as it warns
            warnings.filterwarnings("ignore", message="The last trajectory")
            model.load_replay_buffer(buffer, truncate_last_traj=True)
    else:
        model = learner(env, seed, contender.settings)
    took = float(rows[-1][-1]) if len(rows) > 1 else 0.0
    while model.num_timesteps < steps:
        began = process_time()
        model.learn(every, reset_num_timesteps=False)
        took += process_time() - began
        test.obs_rms = env.obs_rms
        reached, distance = tested(model, test)
        rows.append([str(model.num_timesteps), f"{reached:.1f}", f"{distance:.2f}", f"{took:.1f}"])
        model.save(saved)
        env.save(str(scales))
        model.save_replay_buffer(buffer)
        write_rows(curve, rows)
        print(f"{contender.title}, seed {seed}: {', '.join(rows[-1])}", flush=True)
    env.close()
    test.close()


def draw_all(curves: Mapping[str, list[np.ndarray[Any, Any]]], file: Path) -> None:
    """Draw goals reached against actions."""
    verbs = " and ".join(dict.fromkeys(CONTENDERS[name].verb for name in curves))
    names = ("random", "ppo-single", "ranked-single", "closed-form")
    colours = {CONTENDERS[name].title: own_colour(like) for name, like in zip(CONTENDERS, names, strict=False)}
    note = f"{PROG}; SAC with HER, sparse rewards, {TEST_GOALS} goals; thin: seeds"
    titled = {CONTENDERS[name].title: seeds for name, seeds in curves.items()}
    draw(titled, colours, file, title=f"{verbs} by hindsight", note=note)


def main(argv: list[str] | None = None) -> int:
    """Train what is not trained yet, print a Markdown table, and draw a figure."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/hindsight"), help="folder of the trainings")
    parser.add_argument("--only", nargs="+", choices=CONTENDERS, default=ALIKE, help="some (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=5, help="how many (default: %(default)s)")
    push = CONTENDERS["push"]
    parser.add_argument(
        "--steps", type=int, help=f"actions of a training (default: {Contender.steps}; push: {push.steps})"
    )
    parser.add_argument(
        "--every", type=int, help=f"actions between two tests (default: {Contender.every}; push: {push.every})"
    )
    parser.add_argument("--figure", type=Path, metavar="FILE", help="PNG file")
    given = parser.parse_args(argv)
    for name in ("seeds", "steps", "every"):
        if getattr(given, name) is not None:
            check_count(f"--{name}", getattr(given, name))
    torch.set_num_threads(1)
    for seed in range(given.seeds):
        for name in given.only:
            train(CONTENDERS[name], given.out / name / f"seed-{seed}", seed, given.steps, given.every)
    curves = {
        name: [numbers_of(given.out / name / f"seed-{seed}" / "curve.csv") for seed in range(given.seeds)]
        for name in given.only
    }
    print(head("environment", "reached when within", "reached at the end, %", "distance, mm", "processor, s"))
    for name, seeds in curves.items():
        reached, distance, took = np.array([one[-1, 1:] for one in seeds]).T
        print(
            line(
                CONTENDERS[name].title,
                CONTENDERS[name].criterion,
                spread(reached, 0),
                spread(distance, 1),
                spread(took, 0),
            )
        )
    if given.figure is not None:
        draw_all(curves, given.figure)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

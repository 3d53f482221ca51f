"""Who touches a rolling ball: every method with and without collisions, and where learning overtakes.

    python -m benchmarks.studies.moving_ball                       # the table, a quarter of an hour of one core
    python -m benchmarks.studies.moving_ball --map --figure FILE   # the map
    python -m benchmarks.studies.moving_ball --map --trainings results/train/ppo-moving   # with all seeds of PPO
    python -m benchmarks.studies.moving_ball --beliefs             # the same where a method's model is wrong
    python -m benchmarks.studies.moving_ball --beliefs --rule count   # and collisions count
    python -m benchmarks.studies.moving_ball --map --seed 1 --methods interception interception-told   # find the noise?
    python -m benchmarks.studies.moving_ball --causes moving ppo-moving ppo-moving-clear   # what policies collide with
    python -m benchmarks.studies.moving_ball --trainings results/train/ppo-moving-clear    # all seeds of a recipe
    python -m benchmarks.studies.moving_ball --times               # how long a decision takes, on one core
    python -m benchmarks.studies.moving_ball --paths random        # only of one kind

Each cell is a share of balls, a third of each kind of path; the same balls for all methods, and none that a method was
tuned on. Finished cells are kept in `--out`: an interrupted study goes on. The map changes one thing at a time: the
speed of the ball, the cameras' delay, which methods are told, their noise, and the limits of the arm. Collisions
are ignored in it, because `ppo` was trained without them; `--rule count` has `ppo-moving-clear` instead.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.logs import policies_in
from benchmarks.studies.parts import kept
from benchmarks.studies.tables import head, line, share
from benchmarks.studies.trainings import trainings_interval, with_interval
from kinreach import _provenance as provenance
from kinreach._checks import check_count
from kinreach._files import make_writable, replacing
from kinreach.baselines import load_policy
from kinreach.baselines._batch import make_batch
from kinreach.baselines._evaluation import evaluate
from kinreach.baselines._loop import Policy, as_policy, rollout, rollout_batch
from kinreach.baselines._recipes.reach import FINGERS
from kinreach.cli import Parser, finish
from kinreach.compare._methods.interception import Interception
from kinreach.compare._task import get_task
from kinreach.envs.inside import in_doubles
from kinreach.envs.moving import AGE, DELAY, FRAMES, PATHS
from kinreach.envs.real_arm import MEDIAN_LENGTH, NOISE
from kinreach.kinematics import URKinematics
from kinreach.plots._style import INK, new_figure
from kinreach.robots import get_arm

PROG = "python -m benchmarks.studies.moving_ball"
#: Methods of the table, and by the rule on collisions the learned one of the maps, where it is beside `interception`.
METHODS = ("first-sight", "last-sight", "interception", "gradient-moving", "ppo", "ppo-moving-clear")
LEARNED = {"count": "ppo-moving-clear", "ignored": "ppo"}
#: `interception` that believes a noise: the true one, or that of the cameras as they are by default.
TOLD, WRONG = "interception-told", "interception-wrong"
RULES: Mapping[str, Mapping[str, Any]] = {"count": {"collisions": True}, "ignored": {"collisions": False}}
#: Speeds of the table, which maps have where collisions count [m/s]; worlds of the map.
TABLE_SPEEDS = (0.2, 0.4, 0.6)
WORLDS: Mapping[str, Mapping[str, Any]] = {
    "as trained": {},
    "delay 100 ms": {"delay": 0.1},
    "delay 200 ms": {"delay": 0.2},
    "noise 3 mm": {"noise": 0.003},
    "noise 10 mm": {"noise": 0.01},
    "arm 10 % weaker": {"strength": 0.9},
    "arm 30 % weaker": {"strength": 0.7},
}
#: Worlds of which methods believe something else, or whose arm lags.
BELIEFS: Mapping[str, Mapping[str, Any]] = {
    "as trained": {},
    "delay 10 % above what is believed": {"delay": 1.1 * DELAY, "believed_delay": DELAY},
    "delay 30 % above what is believed": {"delay": 1.3 * DELAY, "believed_delay": DELAY},
    "noise 3 mm": {"noise": 0.003},
    "noise 10 mm": {"noise": 0.01},
    "arm 33 ms late": {"late": 1},
    "arm 100 ms late": {"late": 3},
    "arm follows in 50 ms": {"following": 0.05},
}
#: Worlds with faults of arm, ball and cameras; nobody is told of them.
FAULTS: Mapping[str, Mapping[str, Any]] = {
    "base joints half as strong": {"base_strength": 0.5},
    "ball slows by 0.5 m/s²": {"friction": 0.5},
    "a tenth of the sights 50 mm off": {"outliers": 0.1},
    "30 % of the sights missing": {"dropped": 0.3},
    "all four": {"base_strength": 0.5, "friction": 0.5, "outliers": 0.1, "dropped": 0.3},
}
#: Speeds of the maps where collisions are ignored [m/s].
SPEEDS = (0.4, 0.8, 1.2)


class Believing(gym.Wrapper[Any, Any, Any, Any]):
    """A world of which methods believe something else.

    Args:
        env: The world.
        believed_delay: Age of the sights that methods observe [s]; the true one by default.
        late: Frames after which an action is done; nobody is told.
        following: Time constant with which the posture to go to follows the action, frame by frame [s]; likewise.
        base_strength: Limits of the first three joints as a share of what they would be; likewise.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        *,
        believed_delay: float | None = None,
        late: int = 0,
        following: float = 0.0,
        base_strength: float = 1.0,
    ) -> None:
        super().__init__(env)
        self._world: Any = env.unwrapped
        episodes = self._world.episodes
        episodes.strength = episodes.strength * np.repeat([base_strength, 1.0], 3)
        self._share = 1.0 if believed_delay is None else believed_delay / self._world.options.delay
        self._late = late
        self._kept = np.exp(-1.0 / (FRAMES * following)) if following else 0.0

    def reset(self, **given: Any) -> Any:
        """Begin an episode; until the first action is done, the arm stays."""
        self._doing = self._world.home / np.pi
        self._waiting = self._late * [self._doing]
        observation, info = super().reset(**given)
        return self._believed(observation), info

    def step(self, action: Any) -> Any:
        """Do the action that is due."""
        self._waiting.append(action)
        self._doing = self._kept * self._doing + (1.0 - self._kept) * self._waiting.pop(0)
        observation, *rest = super().step(self._doing)
        return self._believed(observation), *rest

    def _believed(self, observation: Any) -> Any:
        observation[AGE] *= self._share
        return observation


def make_world(options: Mapping[str, Any]) -> gym.Env[Any, Any]:
    """Make the task's environment with options of its own and of `Believing`."""
    task, beliefs = get_task("moving"), ("believed_delay", "late", "following", "base_strength")
    own = {name: value for name, value in options.items() if name not in beliefs}
    others = {name: options[name] for name in beliefs if name in options}
    return Believing(gym.make(task.environment, **{**in_doubles(task.environment), **task.options, **own}), **others)


def touched(name: str, speed: float, options: Mapping[str, Any], *, balls: int, seed: int, out: Path) -> list[bool]:
    """Return which balls a method, or the policy in a file, touches; from the file of this cell if it has one."""

    def played() -> list[bool]:
        task, env = get_task("moving"), make_world({**options, "speeds": (speed,)})
        believed = {TOLD: options.get("noise", NOISE), WRONG: NOISE}
        acting: Any
        if name in believed:
            acting = Interception(env, noise=believed[name] / MEDIAN_LENGTH)
        else:
            acting = task.methods[name].make(env) if name in task.methods else load_policy(name)
        policy: Policy = as_policy(acting)
        return [bool(trial["reached"]) for trial in rollout(env, policy, task.resets(balls, seed, env))]

    method = provenance.digest(Path(name).read_bytes()) if Path(name).is_file() else name
    return kept(out, {"method": method, "speed": speed, **options, "balls": balls, "seed": seed}, played)


def caused(policy: str, balls: int, seed: int) -> list[object]:
    """Return what a policy collides with where collisions count, and how its gripper is then; speeds of the table.

    Returns:
        The policy; shares that touch and that collide [%]; with what, most often first; of those that collide the
        median time [s], distance of tip and ball [mm], tilt of the tool [deg], and depth below the table's top of the
        fingers' lowest corner [mm].
    """
    task, kinematics, cell = (
        get_task("moving"),
        URKinematics("ur5-thesis", tip="tcp", base="world"),
        get_arm("ur5-thesis").workcell,
    )
    with closing(make_batch(task.environment, balls, {**task.options, "speeds": TABLE_SPEEDS})) as env:
        trials = rollout_batch(env, load_policy(policy), seed=seed)
    hits = [trial for trial in trials if trial["impossible"]]
    name, touched = f"`{policy}`", share(sum(trial["is_success"] for trial in trials), balls)
    if not hits:
        return [name, touched, share(0, balls), *5 * "-"]
    T = kinematics.fk(np.array([trial["q"] for trial in hits]))
    away = np.linalg.norm(T[:, :3, 3] - np.array([trial["goal"] for trial in hits]), axis=1)
    lowest = T[:, 2, 3] + (T[:, 2, :3] @ np.transpose(FINGERS)).min(axis=1)
    top = cell.goals.z[0] - cell.ball_radius
    causes = Counter(str(trial["impossible_reason"]) for trial in hits).most_common()
    medians = (
        f"{np.median([trial['time'] for trial in hits]):.2f}",
        f"{1e3 * np.median(away):.0f}",
        f"{np.median(np.degrees(np.arccos(-T[:, 2, 2]))):.0f}",
        f"{1e3 * np.median(top - lowest):.0f}",
    )
    return [name, touched, share(len(hits), balls), ", ".join(f"{cause}: {n}" for cause, n in causes), *medians]


def of_trainings(folder: Path, speed: float, options: Mapping[str, Any], balls: int) -> str:
    """Return the share of held-out balls of one speed that all seeds of a recipe touch [%], with its interval."""
    given = {**get_task("moving").options, **options, "speeds": (speed,)}
    policies = (load_policy(file) for file in policies_in(folder))
    touched = [evaluate(policy, goals=balls, options=given).reached for policy in policies]
    return with_interval(np.array(touched), unit=100, decimals=1)


class Timed:
    """A policy, with the processor time of each of its decisions [ms]."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.reset = policy.reset
        self.decisions: list[float] = []

    def act(self, observation: Any) -> Any:
        """Return the policy's action, and note how long it took."""
        start = time.process_time()
        action = self._policy.act(observation)
        self.decisions.append(1e3 * (time.process_time() - start))
        return action


def times(name: str, balls: int, seed: int) -> list[object]:
    """Return a method, its number of decisions, and their median, 95th percentile and longest time [ms]."""
    task = get_task("moving")
    env = gym.make(task.environment, **{**in_doubles(task.environment), **task.options, "speeds": TABLE_SPEEDS})
    policy = Timed(as_policy(task.methods[name].make(env)))
    first, *resets = task.resets(1 + balls * len(TABLE_SPEEDS), seed, env)
    list(rollout(env, policy, [first]))  # loads what it needs
    policy.decisions.clear()
    list(rollout(env, policy, resets))
    spent = np.array(policy.decisions)
    return [f"`{name}`", len(spent), *(f"{value:.2g}" for value in (*np.quantile(spent, (0.5, 0.95)), spent.max()))]


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--map", action="store_true", help="the map instead of the table")
    parser.add_argument("--beliefs", action="store_true", help="the map of worlds that methods have wrong")
    parser.add_argument("--faults", action="store_true", help="the map of worlds with faults of arm, ball and cameras")
    parser.add_argument("--causes", nargs="+", metavar="POLICY", help="what these policies collide with (300 balls)")
    parser.add_argument("--trainings", type=Path, help="folder of the seeds of a recipe (1000 balls a speed); in a "
                        "map they are the last method")  # fmt: skip
    parser.add_argument("--rule", choices=RULES, default="ignored", help="on collisions, in a map "
                        "(default: %(default)s)")  # fmt: skip
    parser.add_argument("--times", action="store_true", help="how long a decision takes (60 balls a speed)")
    parser.add_argument("--methods", nargs="+", help="names of the task's methods, "
                        f"{TOLD} or {WRONG} (default: those of the table or map)")  # fmt: skip
    parser.add_argument("--speeds", type=float, nargs="+", help="[m/s] (default: three)")
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS), help="of the map (default: all)")
    parser.add_argument("--paths", nargs="+", choices=PATHS, help="kinds of paths (default: all)")
    parser.add_argument("--balls", type=int, help="in each cell (default: 60; map 96, causes 300, trainings 1000)")
    parser.add_argument("--seed", type=int, default=100, help="of the balls (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("results/moving-ball"), help="where finished cells are kept")
    parser.add_argument("--figure", type=Path, help="where the map is drawn")
    arguments = parser.parse_args(argv)
    balls = check_count("--balls", arguments.balls or (96 if arguments.map else 60))
    seed = check_count("--seed", arguments.seed, least=0)
    if arguments.causes:
        print(head("policy", "touched, %", "collided, %", "with what", "time, s", "tip to ball, mm", "tilt, °",
                   "below the table, mm"))  # fmt: skip
        for policy in arguments.causes:
            print(line(*caused(policy, arguments.balls or 300, seed)), flush=True)
        return 0
    if arguments.times:
        print(head("method", "decisions", "median, ms", "p95, ms", "longest, ms"))
        for name in arguments.methods or ("interception", "ppo", "ppo-moving-clear"):
            print(line(*times(name, balls, seed)), flush=True)
        return 0
    mapped = arguments.map or arguments.beliefs or arguments.faults
    if arguments.trainings and not mapped:
        speeds = tuple(arguments.speeds or TABLE_SPEEDS)
        print(head("collisions", *(f"{speed:g} m/s" for speed in speeds)))
        for rule, options in RULES.items():
            cells = (of_trainings(arguments.trainings, v, options, arguments.balls or 1000) for v in speeds)
            print(line(rule, *cells), flush=True)
        return 0
    make_writable(arguments.out)
    worlds, speeds, methods = RULES, TABLE_SPEEDS, METHODS
    if mapped:
        chosen = {name: WORLDS[name] for name in arguments.worlds}
        listed = BELIEFS if arguments.beliefs else chosen if arguments.map else FAULTS
        worlds = {name: {**world, **RULES[arguments.rule]} for name, world in listed.items()}
        speeds = SPEEDS if arguments.rule == "ignored" else TABLE_SPEEDS
        methods = ("interception", *((WRONG,) if arguments.beliefs else ()), LEARNED[arguments.rule])
    speeds, methods = tuple(arguments.speeds or speeds), tuple(arguments.methods or methods)
    files = {name: [name] for name in methods}
    if arguments.trainings:
        files[methods[-1]] = [str(file) for file in policies_in(arguments.trainings)]
    print(head("collisions" if worlds is RULES else "world", "method", *(f"{speed:g} m/s" for speed in speeds)))
    if arguments.paths:
        worlds = {name: {**world, "paths": tuple(arguments.paths)} for name, world in worlds.items()}
    cells = {}
    for world, options in worlds.items():
        for name in methods:
            if name == WRONG and "noise" not in options:
                continue  # it is right
            for speed in speeds:
                one = (touched(file, speed, options, balls=balls, seed=seed, out=arguments.out) for file in files[name])
                cells[world, name, speed] = np.array(list(one))
            row = (with_interval(cells[world, name, speed], unit=100, decimals=1) for speed in speeds)
            print(line(world, f"`{name}`", *row), flush=True)
    if arguments.figure is not None:
        draw(cells, list(worlds), methods, speeds, arguments.figure)
    return 0


def draw(
    cells: Mapping[tuple[str, str, float], np.ndarray],
    worlds: Sequence[str],
    methods: Sequence[str],
    speeds: Sequence[float],
    file: Path,
) -> None:
    """Draw how many percent more balls the first method touches than the second, by world and speed."""
    first, second = methods[:2]
    trainings, balls = cells[worlds[0], second, speeds[0]].shape
    figure, (axes,) = new_figure(
        f"Balls touched, in %: {first} less {second}", size=(8.0, 4.6), grid="none",
        note=f"{balls} balls a cell. Below the difference: {first} / {second}"
        + (f", mean of {trainings} trainings and its interval" if trainings > 1 else ""),
    )  # fmt: skip
    shares = 100.0 * np.array([[[cells[world, name, speed].mean() for speed in speeds] for name in methods[:2]]
                               for world in worlds])  # fmt: skip
    more = shares[:, 0] - shares[:, 1]
    axes.imshow(more, cmap="RdBu_r", vmin=-100, vmax=100, aspect="auto")
    for (row, column), value in np.ndenumerate(more):
        both = f"{shares[row, 0, column]:.0f} / {shares[row, 1, column]:.0f}"
        if trainings > 1:
            low, high = trainings_interval(cells[worlds[row], second, speeds[column]])
            both += f" [{100 * low:.0f}, {100 * high:.0f}]"
        colour = INK if abs(value) < 60 else "white"
        axes.text(column, row - 0.12, f"{value:+.0f}", ha="center", va="center", color=colour, weight="bold")
        axes.text(column, row + 0.24, both, ha="center", va="center", color=colour, fontsize=8)
    axes.set_xticks(range(len(speeds)), [f"{speed:g}" for speed in speeds])
    axes.set_yticks(range(len(worlds)), worlds)
    axes.set_xlabel("speed of the ball [m/s]")
    with replacing(file) as temporary:
        figure.savefig(temporary, format="png")


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

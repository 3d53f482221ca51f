"""The command line of the demo: run an environment with a policy, watch it, print its `info`."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

import kinreach  # registers the environments
from kinreach._checks import check_count, check_known, printable
from kinreach._registration import BUTTON, LIFT, MOVING, MULTI, OBSTACLES, REAL_ARM, SINGLE, SPACE
from kinreach.baselines import rollout
from kinreach.baselines.inside import Policy
from kinreach.cli import HELP, Parser
from kinreach.compare.inside import OptionFlags
from kinreach.demo._caption import SIZE, Caption
from kinreach.demo._film import FILM_FPS, Film
from kinreach.demo._players import RANDOM, new_player, playable
from kinreach.errors import InputError
from kinreach.kinematics.inside import SOLVERS
from kinreach.sim.inside import ScenePicture

PRINTABLE = ("action", "observation", "reward", "info")
#: How many frames the end of an episode stands still.
HOLD = 20


@dataclass(frozen=True)
class DemoTask:
    """An environment that can be watched.

    Attributes:
        policy, steps, printed: Defaults of the command line.
        fps: Frames per second of a film, in the time of the simulation.
        done: Text for success in a film.
    """

    name: str
    policy: str = "closed-form"
    steps: int = 20
    printed: str = "reward"
    fps: int = FILM_FPS
    done: str = "reached"

    @property
    def settings(self) -> Mapping[str, Any]:
        """Defaults of the options of its environment; the button's are those of the course report."""
        return {} if self.name == BUTTON else playable(self.name).options


TASKS: Mapping[str, DemoTask] = {
    "single": DemoTask(SINGLE),
    "multi": DemoTask(MULTI),
    "space": DemoTask(SPACE),
    "real-arm": DemoTask(REAL_ARM, policy="identified", steps=6),
    "moving": DemoTask(MOVING, policy="interception", steps=200, fps=30),
    "obstacles": DemoTask(OBSTACLES, policy="path"),
    "lift": DemoTask(LIFT, steps=5, done="lifted"),
    # By default this is the test that the course report describes.
    "button": DemoTask(BUTTON, policy="random", steps=10_000, printed="action,observation"),
}


def main(argv: Sequence[str], *, prog: str) -> int:
    """Show or film episodes of an environment; return the exit code."""
    arguments = _arguments(argv, prog)
    task = TASKS[arguments.env]
    printed = _printed(arguments.print)
    screen = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform != "linux")
    mode = "rgb_array_list" if arguments.video else "human" if screen else None
    if mode is None:
        print("No screen here: nothing is drawn. --video FILE.gif or FILE.mp4 films it.", file=sys.stderr)
    caption = Caption(arguments.policy, done=task.done)
    env = _make(task, mode, arguments.options | playable(task.name).needed(arguments.policy), caption)
    try:
        policy = new_player(arguments.policy, env, seed=arguments.seed)
        film = (
            Film(arguments.video, fps=task.fps, colours=(*caption.COLOURS, caption.colour))
            if arguments.video
            else nullcontext()
        )
        with film as reel:
            reached, episodes, steps = _run(env, policy, arguments, printed, reel, caption)
    finally:
        env.close()
    if steps < arguments.steps:
        print("The GIF is full; a film named FILE.mp4 has no limit.", file=sys.stderr)
    print(f"{steps} steps, {episodes} episodes, goal reached in {reached}")
    if arguments.video:
        print(printable(f"Film: {arguments.video}"))
    return 0


def _make(task: DemoTask, mode: str | None, options: Mapping[str, Any], caption: Caption) -> gym.Env[Any, Any]:
    env = gym.make(task.name, render_mode=mode, **{**task.settings, **options})
    if mode == "rgb_array_list":
        picture: ScenePicture = env.get_wrapper_attr("_picture")
        picture.size, picture.drawn = SIZE, caption.follow
    return env


def _run(
    env: gym.Env[Any, Any],
    policy: Policy,
    arguments: Any,
    printed: Sequence[str],
    film: Film | None,
    caption: Caption,
) -> tuple[int, int, int]:
    """Play episodes; return how many ended at the goal, their number, and their steps.

    It stops when the steps are done or the film is full.
    """
    reached = episodes = steps = 0
    watched = _Watched(env, printed, film, caption, TASKS[arguments.env].fps)

    def resets() -> Iterator[Mapping[str, Any]]:
        seed = arguments.seed  # of the first episode; the others go on from its generators
        while steps < arguments.steps and not watched.full:
            watched.limit = min(arguments.reset_every, arguments.steps - steps)
            yield {"seed": seed}
            seed = None

    for trial in rollout(watched, policy, resets()):
        reached += trial["is_success"]
        steps += trial["steps"]
        episodes += 1
    return reached, episodes, steps


class _Watched(gym.Wrapper[Any, Any, Any, Any]):
    """Prints and films every step, and ends an episode after `limit` of them."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        printed: Sequence[str],
        film: Film | None,
        caption: Caption,
        fps: int,
    ) -> None:
        super().__init__(env)
        self.limit = 0
        self._printed, self._film, self._caption = printed, film, caption
        self._steps_per_frame = max(1, round(env.metadata.get("render_fps", fps) / fps))
        self._step = self._total = 0

    @property
    def full(self) -> bool:
        """Whether the film has as many frames as it may."""
        return self._film is not None and self._film.full

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        self._step = 0
        observation, info = self.env.reset(**options)
        self._caption.goal, self._caption.verdict = info.get("goal"), ""
        self._see()
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        over = terminated or truncated
        values = {"action": action, "observation": observation, "reward": reward, "info": info}
        for name in self._printed:
            print(printable(f"{self._total} {name}: {_text(values[name])}"))
        self._step += 1
        self._total += 1
        self._see()
        if self._film is not None and (over or self._step % self._steps_per_frame == 0):
            self._add(self._film, over, info)
        return observation, reward, terminated, truncated or self._step >= self.limit or self.full, info

    def _see(self) -> None:
        """Show in the film what the cameras have seen."""
        if self._film is not None and self.env.has_wrapper_attr("measurement"):
            names = [mount.name for mount in self.env.get_wrapper_attr("arm").goal_cameras]
            self._caption.see(names, self.env.get_wrapper_attr("measurement"))

    def _add(self, film: Film, over: bool, info: Mapping[str, Any]) -> None:
        """Add the frames of a step; the last one of an episode stands still, with how it ended."""
        frames: Any = self.env.render()
        caption = self._caption
        moments = caption.moments(len(frames))
        for frame, moment in zip(frames, moments, strict=True):
            film.add(caption.write(frame, moment))
        if over:
            caption.reached = bool(info["is_success"])
            caption.verdict = caption.done if caption.reached else "impossible" if info.get("impossible") else "missed"
            for _ in range(HOLD):
                film.add(caption.write(frames[-1], moments[-1]))


def _text(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=4, suppress_small=True, max_line_width=1000)
    return str(value)


def _printed(names: str) -> list[str]:
    chosen = [name.strip() for name in names.split(",") if name.strip() not in ("", "nothing")]
    for name in chosen:
        check_known("output", name, (*PRINTABLE, "nothing"))
    return chosen


def _arguments(argv: Sequence[str], prog: str) -> Any:
    """Parse the arguments; defaults are the task's, `options` those of its environment."""
    parser = _parser(prog)
    known, _ = parser.parse_known_args([word for word in argv if word not in HELP])  # which task, before its flags
    check_known("env", known.env, TASKS)
    task = TASKS[known.env]
    flags = OptionFlags(task.name, task.settings, taken=("help", *vars(known)))
    flags.add_to(parser, f"options of {known.env}")
    arguments = parser.parse_args(argv)
    arguments.options = flags.options(flags.texts(arguments))
    for name, default in (("policy", task.policy), ("steps", task.steps), ("print", task.printed)):
        if getattr(arguments, name) is None:
            setattr(arguments, name, default)
    if arguments.steps < 1 or arguments.reset_every < 1:
        raise InputError(f"steps and reset-every must be at least 1, got {arguments.steps}, {arguments.reset_every}")
    check_count("seed", arguments.seed, least=0)
    return arguments


def _parser(prog: str) -> Parser:
    def by_task(attribute: str) -> str:
        return ", ".join(f"{name}: {getattr(task, attribute)}" for name, task in TASKS.items())

    trained = sorted({name for task in TASKS.values() for name in playable(task.name).trained()})
    parser = Parser(prog=prog, description=f"Watch an environment of kinreach {kinreach.__version__}.")
    parser.add_argument("--env", default="single", help=f"one of: {', '.join(TASKS)} (default: %(default)s)")
    parser.add_argument(
        "--policy",
        help=f"one of: {', '.join([RANDOM, *SOLVERS, *trained])}; a method of the task; the file of a policy; "
        f"or module:attribute of a policy or solver (default for {by_task('policy')})",
    )
    parser.add_argument("--steps", type=int, metavar="N", help=f"default for {by_task('steps')}")
    parser.add_argument(
        "--reset-every", type=int, default=1000, metavar="N", help="or when an episode ends (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="default: %(default)s")
    parser.add_argument(
        "--print",
        metavar="A,B",
        help=f"any of: {', '.join(PRINTABLE)}, nothing (default for {by_task('printed')})",
    )
    parser.add_argument(
        "--video",
        metavar="FILE",
        help="film it into FILE.gif (every second frame) or FILE.mp4 (VP9, which browsers play), with the distance",
    )
    return parser

"""The command line of the demo: run an environment with a policy, watch it, print what it says."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

import gymnasium as gym
import numpy as np

import kinreach  # registers the environments
from kinreach.baselines.scripted import AnalyticReachPolicy, Policy, RandomPolicy
from kinreach.cli import Parser
from kinreach.demo.film import Film
from kinreach.envs.reach.options import BACKENDS, OBSERVATIONS
from kinreach.errors import InputError, raise_unknown

#: Short name -> environment and the variant that the analytic policy needs.
ENVIRONMENTS = {
    "single": ("kinreach/UR5SingleStep-v0", "single"),
    "multi": ("kinreach/UR5MultiStep-v0", "multi"),
}
POLICIES: dict[str, Callable[[gym.Env[Any, Any], str, int], Policy]] = {
    "random": lambda env, variant, seed: RandomPolicy(env.action_space, seed=seed),
    "analytic": lambda env, variant, seed: AnalyticReachPolicy(variant),
}
PRINTABLE = ("action", "observation", "reward", "info")


def main(argv: Sequence[str], *, prog: str) -> int:
    """Run the demo.

    Args:
        argv: Arguments without the program's name.
        prog: How the user called it, for messages.

    Returns:
        Exit code 0; anything else is raised.

    Raises:
        KinreachError: Bad input, a missing library, a file that cannot be written.
    """
    arguments = _parser(prog).parse_args(argv)
    printed = _printed(arguments.print)
    if arguments.steps < 1 or arguments.reset_every < 1:
        raise InputError(f"steps and reset-every must be at least 1, got {arguments.steps}, {arguments.reset_every}")
    for kind, value, known in (("env", arguments.env, ENVIRONMENTS), ("policy", arguments.policy, POLICIES)):
        if value not in known:
            raise_unknown(kind, value, known)
    name, variant = ENVIRONMENTS[arguments.env]
    screen = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform != "linux")
    mode = "rgb_array_list" if arguments.video else "human" if screen else None
    if mode is None:
        print("No screen here: nothing is drawn. --video FILE.gif or FILE.mp4 films it.", file=sys.stderr)
    env = gym.make(name, observation=arguments.observation, backend=arguments.backend, render_mode=mode)
    try:
        policy = POLICIES[arguments.policy](env, variant, arguments.seed)
        film = Film(arguments.video, fps=env.metadata["render_fps"]) if arguments.video else nullcontext()
        with film as reel:
            reached, episodes = _run(env, policy, arguments, printed, reel)
    finally:
        env.close()
    print(f"{arguments.steps} steps, {episodes} episodes, goal reached in {reached}")
    if arguments.video:
        print(f"Film: {arguments.video}")
    return 0


def _run(
    env: gym.Env[Any, Any], policy: Policy, arguments: Any, printed: Sequence[str], film: Film | None
) -> tuple[int, int]:
    """Step through the episodes; how many ended at the goal, and how many there were."""
    reached = episodes = since_reset = 0
    over = True
    observation: Any = None
    for step in range(arguments.steps):
        if over or since_reset >= arguments.reset_every:
            observation, info = env.reset(seed=arguments.seed if step == 0 else None)
            policy.reset(info)
            episodes += 1
            since_reset = 0
        action = policy.act(observation)
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        since_reset += 1
        reached += int(info["is_success"] and over)
        said = {"action": action, "observation": observation, "reward": reward, "info": info}
        for name in printed:
            print(f"{step} {name}: {_text(said[name])}")
        if film is not None:
            frames: Any = env.render()
            for frame in frames:
                film.add(frame)
    return reached, episodes


def _text(value: Any) -> str:
    return np.array2string(value, precision=4, max_line_width=1000) if isinstance(value, np.ndarray) else str(value)


def _printed(names: str) -> list[str]:
    chosen = [name.strip() for name in names.split(",") if name.strip() not in ("", "nothing")]
    for name in chosen:
        if name not in PRINTABLE:
            raise_unknown("output", name, (*PRINTABLE, "nothing"))
    return chosen


def _parser(prog: str) -> Parser:
    parser = Parser(prog=prog, description=f"Watch an environment of kinreach {kinreach.__version__}.")
    parser.add_argument("--env", default="single", help=f"one of: {', '.join(ENVIRONMENTS)} (default: %(default)s)")
    parser.add_argument("--policy", default="analytic", help=f"one of: {', '.join(POLICIES)} (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=20, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--reset-every", type=int, default=1000, metavar="N", help="or when an episode ends (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="default: %(default)s")
    parser.add_argument("--backend", default="mujoco", help=f"one of: {', '.join(BACKENDS)} (default: %(default)s)")
    parser.add_argument(
        "--observation", default="geometric", help=f"one of: {', '.join(OBSERVATIONS)} (default: %(default)s)"
    )
    parser.add_argument(
        "--print",
        default="reward",
        metavar="A,B",
        help=f"any of: {', '.join(PRINTABLE)}, nothing (default: %(default)s)",
    )
    parser.add_argument("--video", metavar="FILE", help="film it into FILE.gif or FILE.mp4")
    return parser

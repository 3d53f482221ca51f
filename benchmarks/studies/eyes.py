"""What a policy that learned from pictures looks at: the places that its eyes say, on what they saw.

python -m benchmarks.studies.eyes POLICY docs/images/eyes.png
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import kinreach  # noqa: F401 (registers the environments)
from kinreach._files import replacing
from kinreach._registration import SINGLE
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.baselines._eyes import picture_names
from kinreach.baselines._policies import load_policy
from kinreach.cli import Parser, finish
from kinreach.errors import InputError
from kinreach.plots._colours import PALETTE
from notebooks.figures import draw_pictures

PROG = "python -m benchmarks.studies.eyes"
#: Goals of the figure; and of the measure of which channels follow the ball.
SHOWN, WATCHED = 3, 60
#: A channel follows the ball where so much of its place's variance is explained by where the ball is, and its place
#: varies by so much at least, of 2 for the whole picture.
FOLLOWS, MOVES = 0.9, 0.1


def follow(places: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """Which channels follow the ball in both directions, shape (channels,).

    Args:
        places: Columns and rows of an eye, shape (goals, 2 channels).
        goals: In the world [m], shape (goals, 3).
    """
    x, y = (goals[:, axis] for axis in (0, 1))
    terms = np.column_stack([np.ones(len(goals)), x, y, x * x, x * y, y * y])
    rest = places - terms @ np.linalg.lstsq(terms, places, rcond=None)[0]
    explained = 1 - rest.var(axis=0) / np.maximum(places.var(axis=0), 1e-12)
    found: np.ndarray = (explained.reshape(-1, 2) > FOLLOWS).all(axis=1) & (places[:, ::2].std(axis=0) > MOVES)
    return found


def draw(policy: Any, path: Path) -> None:
    """The figure: what both cameras saw of some goals, and the places that follow the ball."""
    env = gym.make(SINGLE, backend="kinematic", **policy.needed_options)
    looks = [env.reset(seed=HELD_OUT + index) for index in range(WATCHED)]
    env.close()
    goals = np.array([info["goal"] for _, info in looks])
    pictures, dots = {}, []
    for eye, key in zip(policy.network.eyes, picture_names(looks[0][0]), strict=True):
        seen = np.stack([observation[key] for observation, _ in looks])
        places = eye(seen)
        chosen = follow(places, goals)
        print(f"{key}: {chosen.sum()} of {len(chosen)} channels follow the ball")
        height, width = seen.shape[1:3]
        for index in range(SHOWN):
            pictures[f"{key.removesuffix('_rgb')}, goal {index}"] = seen[index]
            across, down = places[index].reshape(-1, 2)[chosen].T
            dots.append(((across + 1) * (width - 1) / 2, (down + 1) * (height - 1) / 2))
    figure = draw_pictures(
        pictures, columns=SHOWN, title="Places in the pictures that follow the ball", width=11.0,
        note=f"dot: the place that a channel of the network gives, of channels that follow the ball over {WATCHED} "
        "goals. A place that moves with the ball need not be on it.",
    )  # fmt: skip
    for ax, (u, v) in zip(figure.axes, dots, strict=False):
        ax.scatter(u, v, s=34, color=PALETTE[5], edgecolors="black", linewidths=0.9)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png")


def main(argv: list[str] | None = None) -> int:
    """Draw the figure."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="name or file")
    parser.add_argument("figure", type=Path, help="PNG file")
    arguments = parser.parse_args(argv)
    policy = load_policy(arguments.policy)
    if not policy.network.eyes:
        raise InputError(f"{arguments.policy} sees no pictures")
    draw(policy, arguments.figure)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

"""What a policy does where it was not trained: goals around its volume, steeper tool directions, other starts.

    python -m benchmarks.studies.off_volume space-single docs/images/off_volume.png

Goals on a grid over the table and around it at four heights, the tool straight down; then over the table with the tool
further off the vertical, in random directions; both without dynamics. Then starts further from the start posture, with
goals and directions as in training, in MuJoCo, where the way to a posture counts.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from kinreach._checks import Floats, check_count
from kinreach._files import replacing
from kinreach._registration import SPACE
from kinreach.baselines._loop import rollout_batch
from kinreach.baselines._policies import LearnedPolicy, load_policy
from kinreach.cli import Parser, finish
from kinreach.robots import get_arm
from notebooks.figures import draw_error_maps

PROG = "python -m benchmarks.studies.off_volume"
#: Heights above where balls lie [m]; angles of the tool [degrees]; spreads of the starts [rad].
HEIGHTS, TILTS, SPREADS = (0.0, 0.125, 0.25, 0.35), (45.0, 60.0), (0.3, 1.0)
#: Goals of a map with random directions.
SCATTERED = 400

Map = tuple[Floats, Floats]


def kinematic(policy: LearnedPolicy, goals: Floats, directions: Floats) -> Map:
    """Places (n, 2) [m] and errors [mm], not a number where the posture is impossible."""
    options = {"dtype": "float64", **policy.needed_options, "backend": "kinematic"}
    env: Any = gym.make_vec(SPACE, num_envs=len(goals), vectorization_mode="vector_entry_point", **options)
    home = np.tile(get_arm("ur5-thesis").home, (len(goals), 1))
    trials = rollout_batch(env, policy, seed=0, options={"goal": goals, "direction": directions, "q": home})
    env.close()
    return goals[:, :2], errors_of(trials)


def errors_of(trials: Any) -> Floats:
    """Distances [mm], not a number where the last action was impossible."""
    return np.array([math.nan if trial["impossible"] else 1e3 * trial["distance"] for trial in trials])


def over_the_table(policy: LearnedPolicy, height: float) -> Map:
    """The tool straight down, on a grid that is larger than the area of the goals."""
    lowest = get_arm("ur5-thesis").workcell.goals.z[0]
    xs, ys = np.meshgrid(np.linspace(0.2, 0.75, 23), np.linspace(-0.42, 0.42, 35), indexing="ij")
    goals = np.column_stack([xs.ravel(), ys.ravel(), np.full(xs.size, lowest + height)])
    return kinematic(policy, goals, np.tile([0.0, 0.0, -1.0], (len(goals), 1)))


def tilted(policy: LearnedPolicy, tilt: float) -> Map:
    """Goals in the middle of the volume, the tool off the vertical by so much [degrees], all around."""
    rng = np.random.default_rng(0)
    goals = get_arm("ur5-thesis").workcell.draw_goals(rng, SCATTERED) + np.array([0.0, 0.0, 0.125])
    angle, around = math.radians(tilt), rng.uniform(0.0, 2.0 * math.pi, SCATTERED)
    across = math.sin(angle) * np.array([np.cos(around), np.sin(around)])
    return kinematic(policy, goals, np.column_stack([*across, np.full(SCATTERED, -math.cos(angle))]))


def from_starts(policy: LearnedPolicy, spread: float, count: int) -> Map:
    """Goals and directions as in training, in MuJoCo, from starts that far around the start posture."""
    options = {"dtype": "float64", **policy.needed_options, "start_spread": spread}
    env: Any = gym.make_vec(SPACE, num_envs=count, vectorization_mode="vector_entry_point", **options)
    trials = rollout_batch(env, policy, seed=0)
    goals = env.reset(seed=0)[1]["goal"]
    env.close()
    return goals[:, :2], errors_of(trials)


def main(argv: list[str] | None = None) -> int:
    """Draw the figure."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="name or file, for kinreach/Reach-v0")
    parser.add_argument("figure", type=Path, help="PNG file")
    parser.add_argument("--starts", type=int, default=200, help="goals of each spread (default: %(default)s)")
    arguments = parser.parse_args(argv)
    starts = check_count("--starts", arguments.starts)
    policy = load_policy(arguments.policy, environment=SPACE)
    maps = {
        **{f"{1e3 * height:.0f} mm above, tool down": over_the_table(policy, height) for height in HEIGHTS},
        **{f"125 mm above, tool {tilt:.0f}° off the vertical": tilted(policy, tilt) for tilt in TILTS},
        **{f"starts up to {spread:g} rad off, all heights": from_starts(policy, spread, starts) for spread in SPREADS},
    }
    for name, (_, errors) in maps.items():
        seen = errors[np.isfinite(errors)]
        within = 100 * (seen <= 10).sum() / len(errors)
        print(
            f"{name}: {within:.1f} % within 10 mm, median {np.median(seen):.2f} mm, {np.isnan(errors).sum()} impossible"
        )
    region: Any = get_arm("ur5-thesis").workcell.goals
    figure = draw_error_maps(
        maps,
        title=f"{arguments.policy} inside and outside of where it was trained",
        label="tip to ball [mm]",
        missing="impossible",
        area=(region.x, region.y),
        limits=(0.1, 100),
    )
    with replacing(arguments.figure) as temporary:
        figure.savefig(temporary, format="png")
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

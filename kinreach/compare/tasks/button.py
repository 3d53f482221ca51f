"""The button task as it is: whole episodes of the environment, from the start to the press."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kinreach.baselines.evaluation import HELD_OUT
from kinreach.compare.tasks.base import Task
from kinreach.envs.button import ButtonPressEnv
from kinreach.envs.button.episodes import ButtonOptions

#: Between the environment's seeds of the first goals of two seeds of comparisons: none has as many goals.
SPACING = 2**32


@dataclass(frozen=True)
class EpisodeSettings:
    """How long episodes are and how the arm is driven, with the names of the environment's options.

    Attributes:
        max_steps: Steps after which an episode is over, the same for all methods. The environment's own default is
            1000; with the tuned actuation, 100 steps are 4 s and nearly twice what the analytic controller ever needed.
        actuation: `"tuned"` or `"report"`.

    Raises:
        UnknownNameError: There is no such actuation.
        InputError: No steps.
    """

    max_steps: int = 100
    actuation: str = "tuned"

    def __post_init__(self) -> None:
        _ = self.options

    @property
    def options(self) -> ButtonOptions:
        """The environment's options."""
        return ButtonOptions(self.actuation, False, self.max_steps)


class ButtonTask(Task):
    """Bring the end effector of the arm, which is driven by torque, to the target, and press.

    Args:
        episode: How long episodes are, and how the arm is driven.

    Attributes:
        episode: As given.
    """

    name = "button"
    title = "3-DOF arm under torque: press the button"
    arm_name = "arm3"
    reached_means = "pressed at d < 50 mm within the episode"

    def __init__(self, episode: EpisodeSettings = EpisodeSettings()) -> None:
        super().__init__()
        self.episode = episode

    def new_environment(self) -> ButtonPressEnv:
        """The environment that episodes are played in."""
        return ButtonPressEnv(actuation=self.episode.actuation, max_steps=self.episode.max_steps)

    def environment_seed(self, goal: int, seed: int) -> int:
        """The seed of the environment that gives the target and the arm's start.

        All of them are held out as `kinreach.baselines.evaluation` says: no training draws them. With seed 0 they are
        those of `python -m kinreach.evaluate`.

        Args:
            goal: Its index.
            seed: Of the comparison.
        """
        return HELD_OUT + SPACING * seed + goal

    def terms(self) -> Mapping[str, str]:
        """What every method is given alike."""
        period = self.episode.options.actuation.period
        return {
            "goal": "target and start of an episode of kinreach/ButtonPress-v0: the target uniform in the four "
            "quadrants, kept if some posture reaches it; joints within 0.1 rad of upright and 0.1 rad/s of rest; the "
            f"environment's seeds are {HELD_OUT} + {SPACING} seed + index, which no training draws",
            "distance": "end effector to the target after the last step, in the simulation",
            "reached": self.reached_means,
            "reward": "the environment's, summed over the episode",
            "execution": f"at most {self.episode.max_steps} steps of {1e3 * period:g} ms, the same for all methods; "
            f"actuation {self.episode.actuation}",
        }

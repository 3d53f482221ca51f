"""The options of the button environments, checked in one place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kinreach.envs.button.actuation import ACTUATIONS, Actuation
from kinreach.inputs import check_count, check_known
from kinreach.kinematics.goals import MOST_DISTANCE, Floats, as_vector
from kinreach.robots import ArmDescription, get_arm


@dataclass(frozen=True)
class ButtonOptions:
    """Options of an environment.

    Attributes:
        actuation_name: `"tuned"` or `"report"`.
        fixed_target: Whether episodes keep the target of the first one, or the target of all of them in the world [m].
        max_steps: Steps after which an episode is truncated.

    Raises:
        UnknownNameError: There is no such actuation.
        InputError: A target that is not three finite numbers, or no steps.
    """

    actuation_name: str
    fixed_target: bool | Sequence[float]
    max_steps: int

    def __post_init__(self) -> None:
        check_known("actuation", self.actuation_name, ACTUATIONS)
        check_count("max_steps", self.max_steps)
        _ = self.target

    @property
    def arm(self) -> ArmDescription:
        """The arm that does the task."""
        return get_arm("arm3")

    @property
    def actuation(self) -> Actuation:
        """Motors, friction and time."""
        return ACTUATIONS[self.actuation_name]

    @property
    def keep_target(self) -> bool:
        """Whether a target stays from one episode to the next."""
        return self.fixed_target is not False

    @property
    def target(self) -> Floats | None:
        """The target of all episodes in the world [m], shape (3,), if one was given."""
        return (
            None
            if isinstance(self.fixed_target, bool)
            else as_vector("fixed_target", self.fixed_target, 3, most=MOST_DISTANCE)
        )

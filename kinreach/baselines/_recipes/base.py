"""`Recipe`: everything that a training run depends on beside its seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from kinreach._checks import MAX_DISTANCE, check_count, check_number, shown
from kinreach.errors import InputError


@dataclass(frozen=True)
class Networks:
    """Actor and critic.

    Attributes:
        hidden: Sizes of the hidden layers.
        activation: `"tanh"`, `"silu"`, `"relu"`, `"elu"` or `"leaky_relu"`.
        features: `"raw"`: the observation as it is; `"scaled"`: shifted and scaled by constants; `"goal waves"`: the
            goal alone, scaled, and waves of it; `"waves"`: the same of all; `"button"`: scaled by the constants of the
            button task; `"grasps"`: by those of grasping in small steps; `"objects"`: by those of tasks with an object
            at a table, and the ways from the tip to it and on to the goal; `"sights"`, `"arms"`: by those of rolling
            balls and of random arms, and waves; `"steering"`: fits to the last sights of a rolling ball, where the
            actor's outputs are shares of the motion that joints can make in a frame, and the settings `low` and `high`
            are bounds of the angles [rad], and the fits take a sight in every frame, so that with `hidden` or `dropped`
            a policy can be tried, not trained; `"looks"`: convolutions of both cameras' pictures, in ranked PPO only.
        posture: Whether the actor's output is a change of the start pose [rad], small at first.
        std: Standard deviation of the actions to begin with, where it is learned; 1 is half the range.

    Raises:
        InputError: A size is no count.
    """

    hidden: tuple[int, ...] = (64, 64)
    activation: str = "tanh"
    features: str = "raw"
    posture: bool = False
    std: float = 1.0

    def __post_init__(self) -> None:
        given: Any = self.hidden
        if not isinstance(given, tuple | list):
            raise InputError(f"hidden of networks must be a list of sizes, got {shown(given)}")
        for size in given:
            check_count("a size in hidden of networks", size)


@dataclass(frozen=True)
class Recipe:
    """Everything that a training run depends on, beside its seed.

    Attributes:
        name: As on the command line.
        summary: What it is, in a sentence.
        environment: Id of any registered environment whose observations are vectors; `module:id` imports the module.
        options: Of the environment, as JSON values.
        algorithm: Name of one that is registered, see `kinreach.baselines.register_algorithm`.
        steps: Actions that the learner takes; PPO rounds up to whole rollouts of `n_steps * num_envs` actions.
        num_envs: Environments in step.
        reward: Of the learner: `"own"`, the environment's, or a function of yours as `module:function`, from rewards
            (n,) and the step's `info` as arrays (n,) to rewards (n,). Evaluation uses the environment's own.
        blur: Standard deviation of the noise on observed goals in training [m]; of ranked PPO only.
        beyond: How far beyond the table area goals are drawn in training, on every side [m]; of ranked PPO only.
        walk: Steps of the environment in which a posture is approached in training; of ranked PPO only.
        networks: Actor and critic.
        settings: Keyword arguments of the algorithm, as JSON values.
        segments: Parts of the training, each of which ends with a checkpoint.
        window: Environment steps of a row of the learning curve.
        trace_after: Environment steps after which one episode is kept step by step; None for none.

    Raises:
        InputError: A number is out of range.
    """

    name: str
    summary: str
    environment: str
    algorithm: str
    steps: int
    num_envs: int
    reward: str = "own"
    blur: float = 0.0
    beyond: float = 0.0
    walk: int = 1
    networks: Networks = field(default_factory=Networks)
    settings: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    segments: int = 10
    window: int = 1000
    trace_after: int | None = None

    def __post_init__(self) -> None:
        for name in ("steps", "num_envs", "walk", "segments", "window"):
            check_count(f"{name} of a recipe", getattr(self, name))
        for name in ("blur", "beyond"):
            check_number(f"{name} of a recipe [m]", getattr(self, name), least=0.0, most=MAX_DISTANCE)
        if self.trace_after is not None:
            check_count("trace_after of a recipe", self.trace_after, least=0)

    @property
    def judged_in(self) -> dict[str, Any]:
        """Options of the environment for evaluation, where reaching ends an episode."""
        return {name: value for name, value in self.options.items() if name != "end_on_reached"}

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON types."""
        return asdict(self)

"""What the command line asks the page to show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from kinreach._objects import load_object
from kinreach._registration import MULTI, SINGLE
from kinreach.baselines._policies import load_policy
from kinreach.demo._tasks import trained_for
from kinreach.robots import ArmDescription, arm_names, get_arm
from kinreach.view._figure import Figure
from kinreach.view._players import ARM, playable, playable_names
from kinreach.view._target import TargetModel

#: The parts of the page.
TARGET, REAL_ARM, EPISODES, RESULTS = "Target", "Real arm", "Episodes", "Results"


@dataclass(frozen=True)
class Setup:
    """What every tab begins with.

    Attributes:
        arm: The arm, calibrated if a calibration was given.
        expression: The arm as Python code.
        sheet: The arm by its data sheet as Python code.
        simple: Draw the arm by its collision shapes, for browsers without a graphics card.
        nominal: The arm by its data sheet, where `arm` is calibrated.
        calibration: Path of its calibration.
        policy: Who acts in the first episode: a policy's name or file, or `module:attribute`.
        environment: Id of the environment that episodes begin with; of `module:id` the module is loaded.
        results: Path of a comparison that is opened.
    """

    arm: ArmDescription
    expression: str
    sheet: str
    simple: bool = False
    nominal: ArmDescription | None = None
    calibration: str | None = None
    policy: str | None = None
    results: str | None = None
    environment: str | None = None

    @property
    def title(self) -> str:
        """Title of the browser's tab."""
        return f"kinreach – {(self.nominal or self.arm).name}"

    @property
    def first(self) -> str:
        """The part of the page that a tab begins with."""
        if self.results is not None:
            return RESULTS
        return TARGET if self.policy is None and self.environment is None else EPISODES

    def model(self) -> TargetModel:
        """Make a model for one tab."""
        return TargetModel(self.arm, policies=self.policies)

    @property
    def policies(self) -> tuple[str, ...]:
        """Policies that bring the arm's own tip to a goal: those of the package, and the one that was asked for."""
        name = (self.nominal or self.arm).name
        if name in arm_names() and self.arm.default_tip != get_arm(name).default_tip:
            return ()
        found = [policy for environment in (SINGLE, MULTI) for policy in trained_for(environment, name)]
        own = self.policy or ""
        fits = own and ":" not in own and self.policy_environment in ("", SINGLE, MULTI)
        return tuple(dict.fromkeys([*found, *([own] if fits else [])]))

    @cached_property
    def policy_environment(self) -> str:
        """Id of the environment of the policy; empty without a policy, or if the policy does not name one.

        Raises:
            InputError: Unknown policy, the file is none, or the module cannot be loaded.
        """
        if self.policy is None:
            return ""
        if ":" in self.policy:
            load_object("policy", self.policy)
            return ""
        return load_policy(self.policy).card.environment

    @cached_property
    def environments(self) -> tuple[str, ...]:
        """Environments that can be played, as `playable` takes them; that which was asked for comes first.

        For an arm without goals these are the ones that have an arm of their own.

        Raises:
            InputError: Unknown environment, or its module cannot be loaded.
        """
        wanted = self.policy_environment if self.environment is None else self.environment
        if wanted:
            playable(wanted)
        goals = self.arm.workcell.goals is not None
        names = [name for name in playable_names() if goals or ARM not in playable(name).choices]
        return tuple(dict.fromkeys([*([wanted] if wanted else []), *names]))

    @cached_property
    def figure(self) -> Figure:
        """The arm's links, read once."""
        return Figure(TargetModel(self.arm).kinematics, simple=self.simple)

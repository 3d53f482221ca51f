"""What the command line asks the page to show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from kinreach.baselines.policies import load_policy
from kinreach.demo.tasks import TASKS, trained_for
from kinreach.registration import MULTI, SINGLE
from kinreach.robots import ArmDescription
from kinreach.view.figure import Figure
from kinreach.view.target import TargetModel

#: The parts of the page.
TARGET, REAL_ARM, EPISODES, RESULTS = "Target", "Real arm", "Episodes", "Results"


@dataclass(frozen=True)
class Setup:
    """What every tab begins with.

    Attributes:
        arm: The arm, calibrated if a calibration was given.
        expression: The arm as Python code.
        tip: Short name of its tip; None is the arm's own.
        simple: Draw the arm by its collision shapes, for browsers without a graphics card.
        nominal: The arm by its data sheet, where `arm` is calibrated.
        policy: Of a policy that episodes begin with: name, or path of a file.
        results: Path of a comparison that is opened.
    """

    arm: ArmDescription
    expression: str
    tip: str | None = None
    simple: bool = False
    nominal: ArmDescription | None = None
    policy: str | None = None
    results: str | None = None

    @property
    def first(self) -> str:
        """The part of the page that a tab begins with."""
        return RESULTS if self.results is not None else EPISODES if self.policy is not None else TARGET

    def model(self) -> TargetModel:
        """A model of a tab's own."""
        return TargetModel(self.arm, tip=self.tip, policies=self.policies)

    @property
    def policies(self) -> tuple[str, ...]:
        """Policies that bring the arm's own tip to a goal: those of the package, and the one that was asked for."""
        if self.tip not in (None, self.arm.default_tip):
            return ()
        name = (self.nominal or self.arm).name
        found = [policy for task in ("single", "multi") for policy in trained_for(TASKS[task], name)]
        own = [self.policy] if self.policy is not None and self.policy_environment in ("", SINGLE, MULTI) else []
        return tuple(dict.fromkeys([*found, *own]))

    @cached_property
    def policy_environment(self) -> str:
        """Id of the environment of the policy; empty if there is none, or it does not say.

        Raises:
            InputError: There is no such policy, or the file is none.
        """
        return "" if self.policy is None else load_policy(self.policy).card.environment

    @cached_property
    def figure(self) -> Figure:
        """The arm's links, read once."""
        return Figure(TargetModel(self.arm, tip=self.tip).kinematics, simple=self.simple)

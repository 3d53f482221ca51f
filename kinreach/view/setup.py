"""What the command line asks the page to show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from kinreach.robots import ArmDescription
from kinreach.view.figure import Figure
from kinreach.view.target import TargetModel


@dataclass(frozen=True)
class Setup:
    """What every tab begins with.

    Attributes:
        arm: The arm, calibrated if a calibration was given.
        expression: The arm as Python code.
        tip: Short name of its tip; None is the arm's own.
        simple: Draw the arm by its collision shapes, for browsers without a graphics card.
        nominal: The arm by its data sheet, where `arm` is calibrated.
    """

    arm: ArmDescription
    expression: str
    tip: str | None = None
    simple: bool = False
    nominal: ArmDescription | None = None

    def model(self) -> TargetModel:
        """A model of a tab's own."""
        return TargetModel(self.arm, tip=self.tip)

    @cached_property
    def figure(self) -> Figure:
        """The arm's links, read once."""
        return Figure(TargetModel(self.arm, tip=self.tip).kinematics, simple=self.simple)

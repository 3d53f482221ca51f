"""What a task is to the comparison: a name, a criterion, and the terms on which all methods do it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from kinreach.robots import get_arm


class Task(ABC):
    """One task, the same for every method.

    Attributes:
        name: As on the command line.
        title: For headings.
        arm_name: Which registered arm does it.
        arm: Its description.
        reached_means: The criterion in a few words.
        observations: What can say where the goal is: `"geometric"`, the truth; `"camera"`, the arm's cameras.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    arm_name: ClassVar[str]
    reached_means: ClassVar[str]
    observations: ClassVar[tuple[str, ...]] = ("geometric",)

    def __init__(self) -> None:
        self.arm = get_arm(self.arm_name)

    @abstractmethod
    def terms(self) -> Mapping[str, str]:
        """What every method is given alike, in words, for the record beside the results."""

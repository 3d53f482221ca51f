"""What a comparison is asked to do, checked before anything is measured."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from kinreach.compare.methods import METHODS
from kinreach.compare.tasks import TASKS
from kinreach.errors import InputError, raise_unknown

DEFAULT_GOALS = 200


@dataclass(frozen=True)
class Settings:
    """A comparison: the same settings give the same numbers, times aside.

    Attributes:
        task: Name of a task.
        methods: Names of the methods to compare; all of the task's if empty.
        goals: Number of goals.
        seed: Of the goals. The first N goals of a seed are the same for every number of goals.

    Raises:
        UnknownNameError: A task or method does not exist; the message lists those that do.
        InputError: A number is out of range, or a method is named twice.
    """

    task: str = "ur5"
    methods: tuple[str, ...] = ()
    goals: int = DEFAULT_GOALS
    seed: int = 0

    def __post_init__(self) -> None:
        if self.task not in TASKS:
            raise_unknown("task", self.task, TASKS)
        available = METHODS[self.task]
        object.__setattr__(self, "methods", tuple(self.methods) or tuple(available))
        for name in self.methods:
            if name not in available:
                raise_unknown(f"{self.task} method", name, available)
            if self.methods.count(name) > 1:
                raise InputError(f"method {name!r} is named twice")
        if self.goals < 1:
            raise InputError(f"the number of goals must be at least 1, got {self.goals}")
        if self.seed < 0:
            raise InputError(f"the seed must not be negative, got {self.seed}")

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {**asdict(self), "methods": list(self.methods)}

"""What is compared: one module per task. A new task is a module here and a line in `TASKS`."""

from collections.abc import Mapping

from kinreach.compare.tasks.base import Task, Verdict
from kinreach.compare.tasks.button import ButtonTask
from kinreach.compare.tasks.ur5 import UR5Task

#: Tasks by the name that the command line uses.
TASKS: Mapping[str, type[Task]] = {"ur5": UR5Task, "button": ButtonTask}

__all__ = ["TASKS", "ButtonTask", "Task", "UR5Task", "Verdict"]

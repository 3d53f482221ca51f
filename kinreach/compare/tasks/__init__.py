"""What is compared: one module per task. A new task is a module here and a line in `TASKS`."""

from collections.abc import Mapping

from kinreach.compare.tasks.arm3 import Arm3Task
from kinreach.compare.tasks.base import Task
from kinreach.compare.tasks.button import ButtonTask
from kinreach.compare.tasks.reach import ReachTask, Verdict
from kinreach.compare.tasks.ur5 import UR5Task

#: Tasks that are done by moving to a posture, by the name that the command line uses.
REACH_TASKS: Mapping[str, type[ReachTask]] = {"ur5": UR5Task, "arm3": Arm3Task}
#: All tasks.
TASKS: Mapping[str, type[Task]] = {**REACH_TASKS, "button": ButtonTask}

__all__ = ["REACH_TASKS", "TASKS", "Arm3Task", "ButtonTask", "ReachTask", "Task", "UR5Task", "Verdict"]

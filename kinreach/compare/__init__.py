"""Methods on equal terms: the same goals, look at them, start, controller, reward and machine, one thread.

`python -m kinreach.compare` is the command; from Python:

    from kinreach.compare import compare
    results = compare("ur5", methods=["closed-form", "placo", MySolver()], goals=50, out="results/mine")

A task is data (`Task`): an environment, goals, methods, columns and figures; a method is anything that becomes a policy
for that environment. `register_task` and `register_method` add either from outside the package. The loop between policy
and environment is `kinreach.baselines._loop`.
"""

from kinreach._statistics import Column, Trial, wilson_interval
from kinreach.compare._methods import policy_method, solver_method
from kinreach.compare._runner import Settings, compare
from kinreach.compare._task import (
    Method,
    Task,
    common_columns,
    get_task,
    register_method,
    register_task,
    resets_to,
    task_names,
)

__all__ = [
    "Column",
    "Method",
    "Settings",
    "Task",
    "Trial",
    "common_columns",
    "compare",
    "get_task",
    "policy_method",
    "register_method",
    "register_task",
    "resets_to",
    "solver_method",
    "task_names",
    "wilson_interval",
]

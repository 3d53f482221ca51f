"""Compare methods on the same goals, looks, start, controller, reward and machine, in one thread.

`python -m kinreach.compare` is the command; from Python:

    from kinreach.compare import compare
    methods = ["closed-form", "placo", MySolver()]
    results = compare("ur5", methods=methods, goals=50, out="results/mine")

A task is data (`Task`): an environment, goals, methods, columns and figures. `get_task` gives one by its name,
`register_task` adds one. A method makes a policy for the environment; it is passed to `compare` or part of a task.
`demonstrate` records its episodes as a Minari dataset. The loop is `kinreach.baselines.rollout`.
"""

from kinreach._statistics import Column, wilson_interval
from kinreach.compare._demonstrate import demonstrate
from kinreach.compare._methods.resolve import solver_method
from kinreach.compare._runner import compare
from kinreach.compare._task import (
    Method,
    Task,
    common_columns,
    get_task,
    register_task,
    resets_to,
)

__all__ = [
    "Column",
    "Method",
    "Task",
    "common_columns",
    "compare",
    "demonstrate",
    "get_task",
    "register_task",
    "resets_to",
    "solver_method",
    "wilson_interval",
]

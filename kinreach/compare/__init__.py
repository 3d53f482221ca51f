"""Methods on equal terms: the same goals, look at them, start, controller, reward and machine, one thread.

`python -m kinreach.compare` is the command; from Python:

    from kinreach.compare import Settings, compare
    results = compare(Settings(task="ur5", methods=("closed-form", "placo"), goals=50), out="results/mine")

Solvers give one posture, trained policies act as in their environments; `deciding.GIVEN` says what each kind is given.
For the button task, methods play whole episodes (`kinreach.compare.button`). Where to add things: a method is a line in
`methods.py`, a task a module named in `tasks/__init__.py`; how its methods are tried and reported is a `Contest`.
"""

from kinreach.compare.comparison import compare
from kinreach.compare.settings import Settings
from kinreach.compare.trials import Trial

__all__ = ["Settings", "Trial", "compare"]

"""The interactive page: `python -m kinreach.view` shows arms, all their postures, and why there are none.

From Python, without a browser:

- `TargetModel`: all postures for a target.
- `new_player`: a policy, solver or method by name, for an environment; programs copied from the page call it.
- `read_results`: a comparison, goal by goal.

The modules are internal: `target`, `real_arm`, `episodes` and `results` compute what the panels of the same names draw;
`page` is one tab, `server` all tabs.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kinreach.view._players import new_player
    from kinreach.view._results import read_results
    from kinreach.view._target import TargetModel

#: Name -> its module, imported when the name is first used.
_MODULES = {
    "TargetModel": "_target",
    "new_player": "_players",
    "read_results": "_results",
}

__all__ = ["TargetModel", "new_player", "read_results"]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)

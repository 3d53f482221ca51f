"""The interactive page, `python -m kinreach.view`: arms, every posture for a target, and why a target has none.

From Python, without a browser:

- `TargetModel`: all postures for a target.
- `new_player`: a policy, solver or method by name, for an environment; programs copied from the page call it.
- `read_results`: a comparison, goal by goal.

The modules are internal. `_target`, `_real_arm`, `_episodes` and `_results` compute what the panels of the same names
draw; `_page` is one tab, `_server` serves all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinreach._lazy import on_first_use

if TYPE_CHECKING:
    from kinreach.demo._players import new_player
    from kinreach.view._results import read_results
    from kinreach.view._target import TargetModel

#: Name -> its module, imported when the name is first used.
_MODULES = {
    "TargetModel": "_target",
    "new_player": ".demo._players",
    "read_results": "_results",
}

__all__ = ["TargetModel", "new_player", "read_results"]

__getattr__ = on_first_use(__name__, _MODULES)

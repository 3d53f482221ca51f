"""The interactive page, `python -m kinreach.view`: arms, every posture for a target, and why a target has none.

From Python, without a browser:

- `TargetModel`: all postures for a target.
- `new_player`: a policy, solver or method by name, for an environment; programs copied from the page call it.
- `read_results`: a comparison, goal by goal.

The modules are internal. `_target`, `_real_arm`, `_episodes` and `_results` compute what the panels of the same names
draw; `_page` is one tab, `_server` serves all.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

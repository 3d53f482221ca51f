"""Names that other rooms use; `inside.pyi` lists them, and what users type is in `kinreach.compare`.

- Tasks and methods by name, for whoever plays one episode of them: `all_tasks`, `resolve_methods`, `arm_in`.
- `OptionFlags`: the options of an environment as flags of a command.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)

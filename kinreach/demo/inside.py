"""Names that other rooms use; `inside.pyi` lists them.

- Environments and their players by name: `playable`, `playable_names`, `new_player`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)

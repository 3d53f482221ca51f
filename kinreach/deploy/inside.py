"""Names that other rooms use; `inside.pyi` lists them.

- A motion as `kinreach move` is asked for it, and as it was planned and tried: `MotionFlags`, `TriedMotion`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)

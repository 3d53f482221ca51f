"""What other rooms use of this one, as `inside.pyi` lists it; what users type is in `kinreach.plots`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)

"""Names that other rooms use; `inside.pyi` lists them, and what users type is in `kinreach.plots`.

- Methods in figures: `method_colours`, `text_colour`, `name_label`.
- Axes: `plain_ticks`, `view_from_the_robot`. A figure of a command: `draw_workspace`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__package__, __file__)

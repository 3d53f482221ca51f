"""The style of the figures, for figures of your own task or study.

- `new_figure`: a figure with empty axes; `key` explains its marks, `label_ends` writes names at the ends of lines.
- `colours_of`: the colour that each method has in every figure; `PALETTE`, `INK` and `FAINT` are the other colours.
- `draw_calibration`: errors of a fitted calibration; `draw_error_maps`: errors over the table; `draw_training`: rewards
  of a training, and goals reached, as the thesis's figures 5.1 to 5.4.

Figures of comparisons are drawn in `kinreach.compare`, those of the notebooks in `notebooks/figures`. The modules are
internal.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

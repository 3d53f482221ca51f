"""The style of the figures, for figures of your own task or study.

- `new_figure`: a figure with empty axes; `key` explains its marks, `label_ends` writes names at the ends of lines.
- `colours_of`: the colour that each method has in every figure; `PALETTE`, `INK` and `FAINT` are the other colours.
- `draw_calibration`: errors of a fitted calibration; `draw_error_maps`: errors over the table.

Figures of comparisons are drawn in `kinreach.compare`, those of the notebooks in `notebooks/figures`. The modules are
internal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinreach._lazy import on_first_use

if TYPE_CHECKING:
    from kinreach.plots._calibration import draw_calibration
    from kinreach.plots._maps import draw_error_maps
    from kinreach.plots._methods import PALETTE, colours_of
    from kinreach.plots._style import FAINT, INK, key, label_ends, new_figure

#: Name -> its module, imported when the name is first used: names and colours of methods need no matplotlib.
_MODULES = {
    "FAINT": "_style",
    "INK": "_style",
    "PALETTE": "_methods",
    "colours_of": "_methods",
    "draw_calibration": "_calibration",
    "draw_error_maps": "_maps",
    "key": "_style",
    "label_ends": "_style",
    "new_figure": "_style",
}

__all__ = [
    "FAINT",
    "INK",
    "PALETTE",
    "colours_of",
    "draw_calibration",
    "draw_error_maps",
    "key",
    "label_ends",
    "new_figure",
]

__getattr__ = on_first_use(__name__, _MODULES)

"""The style of the figures: palette, a colour for each method, empty axes, names beside their data.

- `style`: what every figure shares. Figures of comparisons are drawn in `kinreach.compare`, the notebooks' in
  `notebooks/figures`.
- `workspace`: an arm's workspace from the side; `check_cli`: `kinreach check`, which draws it.
"""

from kinreach.plots._style import (
    DPI,
    FAINT,
    INK,
    MAGNITUDE,
    METHOD_COLOURS,
    PALETTE,
    colours_of,
    key,
    label_ends,
    name_label,
    new_figure,
    plain,
    style_axes,
    verbatim,
)

__all__ = [
    "DPI",
    "FAINT",
    "INK",
    "MAGNITUDE",
    "METHOD_COLOURS",
    "PALETTE",
    "colours_of",
    "key",
    "label_ends",
    "name_label",
    "new_figure",
    "plain",
    "style_axes",
    "verbatim",
]

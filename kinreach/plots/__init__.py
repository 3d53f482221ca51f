"""The style of the figures: palette, a name and a colour for each method, empty axes, names beside their data, maps.

- `methods`: the one table of names and colours that comparisons, notebooks, studies and films share.
- `style`: what every figure shares. Figures of comparisons are drawn in `kinreach.compare`, the notebooks' in
  `notebooks/figures`; `maps`: errors over the table, for both.
- `workspace`: an arm's workspace from the side; `check_cli`: `kinreach check`, which draws it.
"""

from kinreach.plots._maps import Area, draw_error_maps, outline, view_from_the_robot
from kinreach.plots._methods import METHOD_COLOURS, PALETTE, colours_of, method_colours, method_name, named
from kinreach.plots._style import (
    DPI,
    FAINT,
    INK,
    MAGNITUDE,
    key,
    label_ends,
    name_label,
    new_figure,
    plain,
    style_axes,
    text_colour,
    verbatim,
)

__all__ = [
    "DPI",
    "FAINT",
    "INK",
    "MAGNITUDE",
    "METHOD_COLOURS",
    "PALETTE",
    "Area",
    "colours_of",
    "draw_error_maps",
    "key",
    "label_ends",
    "method_colours",
    "method_name",
    "name_label",
    "named",
    "new_figure",
    "outline",
    "plain",
    "style_axes",
    "text_colour",
    "verbatim",
    "view_from_the_robot",
]

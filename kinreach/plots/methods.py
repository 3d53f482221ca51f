"""Methods beside each other: success against tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import ArrayLike

from kinreach.errors import InputError
from kinreach.kinematics.goals import as_floats
from kinreach.plots.style import colours_of, label_ends, new_figure, plain


class Success(NamedTuple):
    """Share of goals within each tolerance, of one method.

    Attributes:
        share: 0 to 1, shape (k,).
        interval: Bounds of its confidence interval, shape (k, 2); None if there is none.
    """

    share: ArrayLike
    interval: ArrayLike | None = None


def draw_success(
    tolerances: ArrayLike,
    methods: Mapping[str, Success],
    *,
    title: str = "Share of goals reached within a tolerance",
    xlabel: str = "tolerance [mm]",
    colours: Mapping[str, str] | None = None,
    note: str = "",
) -> Figure:
    """Share of goals against tolerance on a log axis, a line per method with its confidence intervals.

    Args:
        tolerances: Positive, shape (k,), in any order.
        methods: By name.
        title: Of the figure.
        xlabel: What the tolerance is of, with its unit.
        colours: Of the methods; by default those of the palette in order.
        note: Small print.

    Raises:
        InputError: No method, shapes that do not fit, or a tolerance that is not positive.
    """
    x = as_floats("tolerances", tolerances)
    if not methods or x.ndim != 1 or not x.size or not (x > 0).all():
        raise InputError("success against tolerance needs a method and positive tolerances")
    order = np.argsort(x)
    x = x[order]
    colours = colours or colours_of(methods)
    figure, (ax,) = new_figure(title, size=(7.6, 4.6), note=note, grid="y")
    ends = {}
    for rank, (name, success) in enumerate(methods.items()):
        share = 100 * as_floats(f"share of {name}", success.share)
        if share.shape != x.shape:
            raise InputError(f"the share of {name!r} must have shape {x.shape}, got {share.shape}")
        share = share[order]
        # Side by side, so that equal methods do not hide each other.
        at = x * 1.035 ** (rank - (len(methods) - 1) / 2)
        error = None
        if success.interval is not None:
            low, high = 100 * as_floats(f"interval of {name}", success.interval)[order].T
            error = [share - low, high - share]
        ax.errorbar(at, share, error, color=colours[name], lw=1.6, elinewidth=1, marker="o", ms=4)
        ends[name] = (at[0], share[0])
    ax.set(xscale="log", xlim=(x[0] / 1.09, x[-1] * 1.16), ylim=(-3, 103), xlabel=xlabel)
    ax.set_xticks(x, [plain(tick) for tick in x])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.yaxis.tick_right()
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    label_ends(ax, ends, colours, side="left")
    return figure

"""Methods beside each other: success and errors against tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from matplotlib.colors import is_color_like
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import ArrayLike

from kinreach.errors import InputError
from kinreach.inputs import check_number, shown
from kinreach.plots.checks import MOST_DRAWN, as_drawn, check_label, check_mapping
from kinreach.plots.style import INK, colours_of, key, label_ends, new_figure, plain


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
        InputError: No method, shapes that do not fit, a tolerance that is not positive, or a method without a colour.
    """
    check_label("xlabel", xlabel)
    check_mapping("methods", methods)
    x = as_drawn("tolerances", tolerances)
    if not methods or x.ndim != 1 or not x.size or not (x > 0).all():
        raise InputError("success against tolerance needs a method and positive tolerances")
    order = np.argsort(x)
    x = x[order]
    colours = colours_of(methods) if colours is None else colours
    check_mapping("colours", colours)
    figure, (ax,) = new_figure(title, size=(7.6, 4.6), note=note, grid="y")
    ends = {}
    for rank, (name, success) in enumerate(methods.items()):
        if not isinstance(success, Success):
            raise InputError(f"the method {name!r} must be a Success, got {shown(success)}")
        if not is_color_like(colours.get(name)):
            raise InputError(f"colours must have one for {name!r}, got {shown(colours.get(name))}")
        share = 100 * as_drawn(f"share of {name}", success.share)
        if share.shape != x.shape:
            raise InputError(f"the share of {name!r} must have shape {x.shape}, got {share.shape}")
        share = share[order]
        # Side by side, so that equal methods do not hide each other.
        at = x * 1.035 ** (rank - (len(methods) - 1) / 2)
        error = None
        if success.interval is not None:
            bounds = 100 * as_drawn(f"interval of {name}", success.interval)
            if bounds.shape != (*x.shape, 2):
                raise InputError(f"the interval of {name!r} must have shape {(*x.shape, 2)}, got {bounds.shape}")
            low, high = bounds[order].T
            if not ((low <= share + 1e-9) & (share <= high + 1e-9)).all():
                raise InputError(f"the interval of {name!r} must be around its share")
            low, high = np.minimum(low, share), np.maximum(high, share)
            error = [share - low, high - share]
        ax.errorbar(at, share, error, color=colours[name], lw=1.6, elinewidth=1, marker="o", ms=4)
        ends[name] = (at[0], share[0])
    ax.set(xscale="log", xlim=(x[0] / 1.09, x[-1] * 1.16), ylim=(-3, 103), xlabel=xlabel)
    ax.set_xticks(x, [plain(tick) for tick in x])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.tick_params(which="minor", length=0)
    ax.yaxis.tick_right()
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0f} %"))
    label_ends(ax, ends, colours, side="left")
    return figure


def draw_error_bands(
    tolerances: ArrayLike,
    errors: Mapping[str, ArrayLike],
    *,
    title: str,
    xlabel: str,
    ylabel: str = "distance to the goal [mm]",
    limit: float | None = None,
    note: str = "",
) -> Figure:
    """Errors of many goals against what they depend on, both on log axes: median, and the middle 90 %.

    Args:
        tolerances: Positive, shape (k,), in any order.
        errors: By the method's name, positive, shape (k, n): those of n goals at each tolerance.
        title: Of the figure.
        xlabel: What the tolerance is of, with its unit.
        ylabel: What the error is, with its unit.
        limit: Error that is allowed; dashed.
        note: Small print.

    Raises:
        InputError: No method, shapes that do not fit, or a tolerance, an error or a limit that is not positive.
    """
    check_label("xlabel", xlabel)
    check_label("ylabel", ylabel)
    check_mapping("errors", errors)
    x = as_drawn("tolerances", tolerances)
    if not errors or x.ndim != 1 or not x.size or not (x > 0).all():
        raise InputError("errors against tolerance need a method and positive tolerances")
    if limit is not None:
        limit = check_number("limit", limit, above=0.0, most=MOST_DRAWN)
    order = np.argsort(x)
    x = x[order]
    figure, (ax,) = new_figure(title, size=(7.6, 4.6), note=note)
    colours, ends = colours_of(errors), {}
    for name, values in errors.items():
        sample = as_drawn(f"errors of {name}", values)
        if sample.ndim != 2 or len(sample) != len(x) or not sample.size or not (sample > 0).all():
            raise InputError(f"the errors of {name!r} must be positive, of shape ({len(x)}, n), got {sample.shape}")
        low, middle, high = np.percentile(sample[order], (5, 50, 95), axis=1)
        ax.fill_between(x, low, high, color=colours[name], alpha=0.2, lw=0)
        ax.plot(x, middle, color=colours[name], lw=1.8, marker="o", ms=4)
        ends[name] = (x[0], middle[0])
    ax.set(xscale="log", yscale="log", xlim=(x[0] / 1.09, x[-1] * 1.09), xlabel=xlabel, ylabel=ylabel)
    ax.set_xticks(x, [plain(tick) for tick in x])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.tick_params(which="minor", length=0)
    ax.yaxis.tick_right()
    ax.yaxis.set_label_position("right")
    ax.yaxis.set_major_formatter(FuncFormatter(plain))
    said = "line: median · band: 90 % of the goals"
    if limit is not None:
        ax.axhline(limit, color=INK, lw=1.2, ls="--", zorder=1)
        said += f" · dashed: {limit:g}, which is allowed"
    key(ax, said)
    label_ends(ax, ends, colours, side="left")
    return figure

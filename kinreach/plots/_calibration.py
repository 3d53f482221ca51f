"""A fitted calibration: errors before and after, at the rows and over the workspace."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kinreach._checks import Floats
from kinreach.errors import InputError
from kinreach.plots._colours import PALETTE
from kinreach.plots._style import INK, name_label, new_figure, plain_ticks
from kinreach.robots import CalibratedArm


def draw_calibration(result: CalibratedArm) -> Figure:
    """Draw how far the data sheet and the calibration are off, sorted, on one axis of millimetres.

    Args:
        result: A calibration that was fitted.

    Raises:
        InputError: It was read, not fitted.
    """
    fit = result.fit
    if fit is None:
        raise InputError("a calibration that was read has no errors to draw")
    figure, (rows, space) = new_figure(
        f"Calibration of a {name_label(' or '.join(result.models) or result.arm.title)}",
        columns=2,
        size=(9.0, 4.0),
        note=f"Left: {fit.rows} rows, {len(fit.dropped)} dropped. Right: {len(fit.expected)} random postures.",
    )
    before, after = PALETTE[1], PALETTE[0]
    _shares(rows, fit.before, before, "data sheet")
    _shares(rows, fit.held_out, after, "calibration, rows left out of the fit")
    _shares(space, fit.correction, before, "what the data sheet misses")
    _shares(space, fit.expected, after, "expected error that is left")
    for axes, where in ((rows, "rows"), (space, "postures")):
        axes.set_xscale("log")
        axes.set_xlabel("distance of the tool [mm]")
        axes.set_ylabel(f"share of the {where} within it [%]")
        axes.set_ylim(0.0, 124.0)  # room for the legend above the lines
        axes.set_yticks(range(0, 101, 20))
        plain_ticks(axes.xaxis)
        axes.legend(loc="upper left", frameon=False, labelcolor=INK, fontsize=8)
    return figure


def _shares(axes: Axes, distances: Floats, colour: str, label: str) -> None:
    """Draw which share of some distances [m] is within which."""
    values = 1e3 * np.maximum(np.sort(distances), 1e-10)
    axes.step(values, 100.0 * (np.arange(len(values)) + 1) / len(values), where="post", color=colour, label=label)

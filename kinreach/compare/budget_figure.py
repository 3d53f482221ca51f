"""The error budget as a picture: what share of each method's distance seeing, deciding and moving have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from kinreach.compare.budget import MEANING, Budget
from kinreach.compare.tables import number
from kinreach.plots.style import FAINT, INK, PALETTE, name_label, new_figure

_COLOURS = dict(zip(Budget._fields, (PALETTE[5], PALETTE[1], PALETTE[2]), strict=True))

#: Shares below this are not labelled: there is no room [%].
_LABELLED = 9.0


def draw_budget(results: Mapping[str, Any], *, note: str) -> Figure:
    """A bar of 100 % per method, with millimetres beside it.

    Shares, because the distances of methods differ by orders of magnitude. A part that takes the tip back towards the
    goal is drawn to the left of zero; the others then are more than 100 %.

    Args:
        results: Contents of `results.json`.
        note: Small print.
    """
    methods = results["methods"]
    figure, (axes,) = new_figure(
        "Where the distance comes from", size=(9.0, 1.8 + 0.42 * len(methods)), note=note, grid="x"
    )
    low, high = 0.0, 100.0
    for row, method in enumerate(methods):
        parts = dict(method["budget_mm"])
        distance = parts.pop("distance")
        if not distance:
            axes.annotate("none" if distance is None else "0", (2, row), va="center", fontsize=8.5, color=FAINT)
            continue
        ends = {False: 0.0, True: 0.0}  # of the bar so far, to the right and to the left
        for name, part in parts.items():
            share, negative = 100 * part / distance, part < 0
            axes.barh(row, share, left=ends[negative], height=0.6, color=_COLOURS[name])
            if abs(share) >= _LABELLED:
                at = ends[negative] + share / 2
                axes.annotate(f"{share:.0f} %", (at, row), ha="center", va="center", fontsize=8, color=INK)
            ends[negative] += share
        low, high = min(low, ends[True]), max(high, ends[False])
        text = " + ".join(number(part) for part in parts.values()).replace("+ -", "- ")
        axes.annotate(
            f"{text} = {number(distance)} mm", (1.02, row), xycoords=("axes fraction", "data"), va="center",
            fontsize=8.5, color=INK, annotation_clip=False,
        )  # fmt: skip
    axes.set_yticks(range(len(methods)), [name_label(method["name"]) for method in methods], weight="bold")
    axes.set(ylim=(len(methods) - 0.5, -0.5), xlim=(low, high))
    axes.set_xlabel(f"share of the mean distance [%]\n{MEANING}", fontsize=9)
    for name, colour in _COLOURS.items():
        axes.barh(0, 0, color=colour, label=name)
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1.0), ncols=len(_COLOURS), frameon=False, fontsize=9, labelcolor=INK,
        borderpad=0.2, handlelength=1.2,
    )  # fmt: skip
    return figure

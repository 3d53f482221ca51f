"""Learning curves of goals reached: kept as CSV files, one a training, and drawn with all trainings."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kinreach._files import replacing
from kinreach.plots._style import key, label_ends, new_figure

#: Of a curve: actions, reached of the test's goals in percent, median distance at the end of an episode, and time.
COLUMNS = ("steps", "reached %", "distance mm", "processor s")


def rows_of(curve: Path) -> list[list[str]]:
    """Return the rows of a curve, with the names of its columns."""
    if not curve.exists():
        return [list(COLUMNS)]
    with curve.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def write_rows(curve: Path, rows: Sequence[Sequence[str]]) -> None:
    """Write a curve, whole or not at all."""
    with replacing(curve) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)


def numbers_of(curve: Path) -> np.ndarray[Any, Any]:
    """Return the rows of a curve as numbers."""
    return np.array(rows_of(curve)[1:], dtype=float)


def draw(
    curves: Mapping[str, Sequence[np.ndarray[Any, Any]]],
    colours: Mapping[str, str],
    file: Path,
    *,
    title: str,
    note: str,
) -> None:
    """Draw goals reached against actions: thin the seeds, thick their mean; by names that stand at the ends."""
    figure, (axes,) = new_figure(title, size=(7.6, 4.0), note=note)
    ends = {}
    for name, seeds in curves.items():
        for one in seeds:
            axes.plot(one[:, 0], one[:, 1], color=colours[name], lw=0.7, alpha=0.5)
        rows = min(map(len, seeds))
        middle = np.mean([one[:rows] for one in seeds], axis=0)
        axes.plot(middle[:, 0], middle[:, 1], color=colours[name], lw=2.0)
        ends[name] = middle[-1, :2]
    axes.set(ylim=(-3, 103), xlabel="actions")
    key(axes, "goals reached [%]")
    label_ends(axes, ends, colours)
    with replacing(file) as temporary:
        figure.savefig(temporary, format="png")

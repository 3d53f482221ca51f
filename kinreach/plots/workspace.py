"""Where an arm is agile, and where its data sheet is wrong."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from kinreach.kinematics import ArmKinematics, check
from kinreach.plots.style import MAGNITUDE, key, new_figure

#: Cells of the picture along one side.
CELLS = 40


def draw_workspace(kinematics: ArmKinematics, believed: ArmKinematics | None = None, *, seed: int = 0) -> Figure:
    """The workspace from the side: how far the data sheet is off, or how far from singular the arm is.

    Args:
        kinematics: Of the arm as it is.
        believed: Of its data sheet, where the arm is a calibrated one.
        seed: Of the random postures.
    """
    if believed is not None:
        found = check.deviation(kinematics, believed, seed=seed, count=20 * check.POSTURES)
        tip, values = found.tip, 1e3 * found.position
        title, label = "What the data sheet misses", "mean distance of the tip [mm]"
    else:
        q = check.random_postures(kinematics, check.POSTURES, seed)
        tip = check.from_first_joint(kinematics, kinematics.positions(q))
        scale = check.reach_of(kinematics, seed=seed).farthest
        values = np.array([check.smallest_singular_value(kinematics, posture, scale) for posture in q])
        title, label = "Where the arm is agile", "mean smallest singular value (arm as of 1 m)"
    figure, (axes,) = new_figure(
        f"{title}: {kinematics.arm.name}",
        size=(5.0, 6.4),
        note=f"{len(tip)} random postures within the limits, seed {seed}; tip {kinematics.tip}, from the first joint.",
    )
    distance, height = np.hypot(tip[:, 0], tip[:, 1]), tip[:, 2]
    across = CELLS // 2
    up = max(1, round(across * np.ptp(height) / np.ptp(distance) / np.sqrt(3.0)))  # regular hexagons
    cells = axes.hexbin(distance, height, values, gridsize=(across, up), cmap=MAGNITUDE)
    axes.set_aspect("equal")
    axes.set_xlabel("distance from the first joint's axis [m]")
    axes.set_ylabel("height [m]")
    key(axes, label)
    figure.colorbar(cells, ax=axes, shrink=0.8)
    return figure

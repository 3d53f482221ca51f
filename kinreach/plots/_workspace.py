"""An arm's workspace: how far it is from singular, or how far its data sheet is off."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from kinreach.kinematics import ArmKinematics, check
from kinreach.plots._style import MAGNITUDE, name_label, new_figure


def draw_workspace(kinematics: ArmKinematics, believed: ArmKinematics | None = None, *, seed: int = 0) -> Figure:
    """Draw the workspace from the side, coloured by the distance from singularity.

    Args:
        kinematics: Of the arm.
        believed: Of the data sheet of a calibrated arm; then the colour is the data sheet's error.
        seed: Of the random postures.
    """
    if believed is not None:
        found = check.deviation(kinematics, believed, seed=seed, count=20 * check.POSTURES)
        tip, values = found.tip, 1e3 * found.position
        title, label = "What the data sheet misses", "distance of the tip, mean of a cell [mm]"
    else:
        q = check.random_postures(kinematics, check.POSTURES, seed)
        tip = check.from_first_joint(kinematics, kinematics.positions(q))
        scale = check.reach_of(kinematics, seed=seed).farthest
        values = np.array([check.smallest_singular_value(kinematics, posture, scale) for posture in q])
        title, label = "Where the arm is agile", "smallest singular value, mean of a cell (arm as of 1 m)"
    figure, (axes,) = new_figure(
        f"{title}:\n{name_label(kinematics.arm.name)}",
        size=(5.0, 6.4),
        note=f"{len(tip)} random postures within the limits, seed {seed}; tip {kinematics.tip}, from the first joint.",
    )
    distance, height = np.hypot(tip[:, 0], tip[:, 1]), tip[:, 2]
    across = 20  # cells
    up = max(1, round(across * np.ptp(height) / np.ptp(distance) / np.sqrt(3.0)))  # regular hexagons
    cells = axes.hexbin(distance, height, values, gridsize=(across, up), cmap=MAGNITUDE)
    axes.set_aspect("equal")
    axes.set_xlabel("distance from the first joint's axis [m]")
    axes.set_ylabel("height [m]")
    figure.colorbar(cells, ax=axes, shrink=0.8, label=label).outline.set_visible(False)
    return figure

"""A motion of an arm over time: what each joint does, and how much of its speed it uses."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from kinreach._checks import Floats
from kinreach.kinematics.inside import Trajectory
from kinreach.plots import label_ends, new_figure
from kinreach.plots.inside import name_label


def draw_motion(trajectory: Trajectory, speed_limit: Floats, title: str) -> Figure:
    """Draw joint angles and speeds over time.

    Args:
        trajectory: The motion.
        speed_limit: Of the joints [rad/s], shape (n,).
        title: Of the figure.
    """
    figure, (angles, speeds) = new_figure(name_label(title), columns=2, size=(9.0, 4.0))
    names = [name_label(joint.removesuffix("_joint")) for joint in trajectory.joints]
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(names)))
    colours = {name: to_hex(shade) for name, shade in zip(names, shades, strict=True)}
    degrees, shares = np.degrees(trajectory.q), 100.0 * trajectory.qd / speed_limit
    for joint, name in enumerate(names):
        angles.plot(trajectory.t, degrees[:, joint], color=colours[name])
        speeds.plot(trajectory.t, shares[:, joint], color=colours[name])
    for axes in (angles, speeds):
        axes.set_xlim(0.0, trajectory.duration)
        axes.set_xlabel("time [s]")
    angles.set_ylabel("joint angle [degrees]")
    speeds.set_ylabel("joint speed [% of its limit]")
    ends = {name: (trajectory.duration, end) for name, end in zip(names, degrees[-1], strict=True)}
    label_ends(angles, ends, colours)
    return figure

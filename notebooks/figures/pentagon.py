"""The arm as the thesis's pentagon (section 3.4.4, figures 3.4 to 3.7), drawn on the arm's joints.

Coordinates are (reach, height) [m] in the arm's plane, which is vertical and contains upper arm and forearm. Reach is
the distance from the base's axis towards the tip, height that of the world.

The thesis writes the sum of the pentagon's interior angles as 3 pi = delta + pi/2 + pi/2 + gamma + (pi - beta) + alpha:
six terms for five corners. They fit if the pentagon stands on the ground: the corner at the foot is pi/2, and that at
the shoulder is pi/2 below the horizontal plus alpha above it.

The edge of the tool runs through wrist_1, parallel to the tool: the UR5's wrist moves the tool sideways by d5 = 95 mm
within the plane, which turns no angle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Wedge
from numpy.typing import ArrayLike, NDArray

from kinreach.kinematics import URKinematics
from kinreach.plots import FAINT, INK, PALETTE, new_figure
from kinreach.robots import CameraMount
from kinreach.thesis import pentagon_angles

from .pictures import Picture

Floats = NDArray[np.float64]
#: Left, right, bottom and top of a picture in the arm's plane [m].
Extent = tuple[float, float, float, float]

#: Joints whose origins are corners, by their number in the thesis: shoulder (j1), elbow (j2), wrist_1 (j3).
_CORNERS = (1, 2, 3)
#: Place of an angle's label, from its corner [m].
_OFFSETS = {"α": (-0.11, 0.03), "π−β": (0.0, 0.07), "γ": (-0.18, -0.04), "δ": (-0.18, 0.05)}
_PAPER = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8}
_COLOURS = {"α": PALETTE[0], "π−β": PALETTE[1], "β": PALETTE[1], "γ": PALETTE[2], "δ": PALETTE[3]}


@dataclass(frozen=True)
class Pentagon:
    """Corners and angles of an arm in one posture.

    Attributes:
        corners: Foot, shoulder, elbow, wrist_1 and the gripper, shape (5, 2) [m].
        joints: Origins of all six joints and the tip, shape (7, 2) [m].
        angles: Alpha, beta, gamma and delta of the reward [rad].
        q: The posture [rad], shape (6,).
        forward: Direction of reach in the world, shape (3,).
        turn: +1 where growing joint angles turn the links counterclockwise with reach to the right, else -1.
    """

    corners: Floats
    joints: Floats
    angles: Any
    q: Floats
    forward: Floats
    turn: float


def joint_origins(kin: URKinematics, q: ArrayLike) -> Floats:
    """Compute the origins of the six joints in the frame of `kin` [m], shape (6, 3)."""
    pin.forwardKinematics(kin.model, kin.data, np.asarray(q, dtype=float))
    return np.array([kin.data.oMi[joint].translation for joint in range(1, 7)])


def pentagon_of(q: ArrayLike, *, ground: float, kinematics: URKinematics | None = None) -> Pentagon:
    """Compute the pentagon of a posture by forward kinematics.

    Args:
        q: Posture [rad], shape (6,), in which the tool points towards the ground.
        ground: Height on which the pentagon stands [m].
        kinematics: Of the arm in the world frame; by default of the UR5's tcp.
    """
    kin = kinematics or URKinematics("ur5-thesis", tip="tcp", base="world")
    posture = np.asarray(q, dtype=float)
    T_world_tip = kin.fk(posture)
    joints = np.vstack([joint_origins(kin, posture), T_world_tip[:3, 3]])
    # the plane is square to the elbow's axis, which is level
    normal = kin.data.oMi[3].rotation[:, 1]
    forward = np.cross(normal, (0.0, 0.0, 1.0))
    side = 1.0 if forward @ (joints[-1] - joints[0]) >= 0 else -1.0
    forward *= side / np.linalg.norm(forward)
    flat = np.column_stack([(joints - joints[0]) @ forward, joints[:, 2]])
    tool = np.array([T_world_tip[:3, 2] @ forward, T_world_tip[2, 2]])
    wrist = flat[_CORNERS[-1]]
    gripper = wrist + tool * (ground - wrist[1]) / tool[1]
    foot = np.array([flat[1, 0], ground])
    corners = np.vstack([foot, flat[list(_CORNERS)], gripper])
    return Pentagon(corners, flat, pentagon_angles(posture), posture, forward, -side)


def side_camera(pentagon: Pentagon, *, width: int, height: int) -> tuple[CameraMount, Extent]:
    """Place a camera named `side` that looks perpendicularly at the arm's plane from 8 m.

    From there, a part 0.1 m in front of or behind the plane is drawn 1 % too large or too small.

    Args:
        pentagon: Of the posture to be drawn.
        width: Of the picture [pixels].
        height: Of the picture [pixels].

    Returns:
        The camera, to be added to an arm's description, and the extent of its picture in the plane.
    """
    middle, half, away = (0.25, 0.12), 0.53, 8.0  # reach and height of the centre, half of what is seen, distance [m]
    target = middle[0] * pentagon.forward + (0.0, 0.0, middle[1])
    position = target + away * np.cross(pentagon.forward, (0.0, 0.0, 1.0))
    fovy = 2 * math.degrees(math.atan(half / away))
    mount = CameraMount("side", "world", tuple(position), tuple(target), fovy=fovy)
    across = half * width / height
    return mount, (middle[0] - across, middle[0] + across, middle[1] - half, middle[1] + half)


def draw_pentagons(
    pentagons: Mapping[str, Pentagon],
    *,
    title: str = "The arm as a pentagon",
    pictures: Mapping[str, tuple[Picture, Extent]] | None = None,
    note: str = "",
) -> Figure:
    """Draw pentagons with their angles beside each other (thesis, figure 3.4).

    Args:
        pentagons: By name.
        title: Of the figure.
        pictures: Name -> picture of the arm from the side, and its extent.
        note: Small print.
    """
    pictures = pictures or {}
    figure, axes = new_figure(title, size=(5.0 * len(pentagons), 4.9), columns=len(pentagons), note=note, grid="none")
    for ax, (name, pentagon) in zip(axes, pentagons.items(), strict=True):
        corners, angles = pentagon.corners, pentagon.angles
        if name in pictures:
            pixels, extent = pictures[name]
            ax.imshow(pixels, extent=extent, alpha=0.75)
        else:
            ax.plot(*pentagon.joints.T, color=FAINT, lw=5, alpha=0.4, solid_capstyle="round", solid_joinstyle="round")
        ax.add_patch(Polygon(corners, fill=False, ec=INK, lw=2.0, joinstyle="round"))
        foot, shoulder, elbow, wrist, gripper = corners
        _right_angle(ax, foot, (1, 0), (0, 1))
        _right_angle(ax, shoulder, (1, 0), (0, -1))
        ax.plot([shoulder[0], shoulder[0] + 0.22], [shoulder[1]] * 2, color=INK, lw=1, ls=":")
        parts = (
            ("α", shoulder, (1.0, 0.0), elbow - shoulder, angles.alpha),
            ("π−β", elbow, shoulder - elbow, wrist - elbow, math.pi - angles.beta),
            ("γ", wrist, elbow - wrist, gripper - wrist, angles.gamma),
            ("δ", gripper, wrist - gripper, foot - gripper, angles.delta),
        )
        for letter, corner, start, end, angle in parts:
            _sector(ax, corner, start, end, letter, radius=0.09)
            x, y = corner + _OFFSETS[letter]
            ax.annotate(f"{letter} = {math.degrees(angle):.0f}°", (x, y), ha="center", va="center", fontsize=10,
                        color=_COLOURS[letter], weight="bold", bbox=_PAPER)  # fmt: skip
        low, high = np.minimum(corners.min(axis=0), pentagon.joints.min(axis=0)), corners.max(axis=0)
        ax.set(xlim=(low[0] - 0.24, high[0] + 0.24), ylim=(low[1] - 0.1, high[1] + 0.14), aspect="equal")
        ax.set(xlabel="reach in the arm's plane [m]", ylabel="height [m]")
        ax.set_title(name, loc="left", fontsize=10, weight="bold", color=INK)
    return figure


def draw_pentagon_angles(pentagon: Pentagon, *, title: str = "How the joints' angles make the pentagon's") -> Figure:
    """Draw the circles of alpha, beta and gamma: each link's direction by joint angle (thesis, figures 3.5 to 3.7)."""
    figure, axes = new_figure(title, size=(9.6, 3.9), columns=3, bare=True)
    _, shoulder, elbow, wrist, gripper = pentagon.corners
    alpha, beta, gamma, _ = pentagon.angles
    cases = (  # the sector is drawn counterclockwise from one direction to the other
        ("figure 3.5: α at the shoulder", "α", (1.0, 0.0), elbow - shoulder, elbow - shoulder, 1, alpha),
        ("figure 3.6: β at the elbow", "β", wrist - elbow, elbow - shoulder, wrist - elbow, 2, beta),
        ("figure 3.7: γ at wrist_1", "γ", elbow - wrist, gripper - wrist, gripper - wrist, 3, gamma),
    )
    for ax, (name, letter, start, end, link, joint, value) in zip(axes, cases, strict=True):
        angle, heading = pentagon.q[joint], _heading(link)
        ax.add_patch(Circle((0, 0), 1.0, fill=False, color=FAINT, lw=1))
        for mark, text in ((0.0, "0"), (-math.pi / 2, "−π/2"), (math.pi / 2, "π/2"), (math.pi, "±π")):
            direction = heading + pentagon.turn * (mark - angle)
            x, y = math.cos(direction), math.sin(direction)
            ax.plot([0.95 * x, 1.05 * x], [0.95 * y, 1.05 * y], color=FAINT, lw=1)
            ax.annotate(text, (1.24 * x, 1.2 * y), ha="center", va="center", fontsize=9, color=FAINT)
        if joint > 1:
            _ray(ax, pentagon.corners[joint - 1] - pentagon.corners[joint], color=FAINT, lw=5, alpha=0.4)
        for side in (start, end):
            _ray(ax, side, color=INK, lw=1, ls=":")
        _ray(ax, link, color=INK, lw=4, solid_capstyle="round")
        _sector(ax, np.zeros(2), start, end, letter, radius=0.55)
        ax.plot(0, 0, "o", ms=7, color=INK)
        ax.set(xlim=(-1.5, 1.5), ylim=(-1.75, 1.4), aspect="equal")
        ax.set_title(name, loc="left", fontsize=10, weight="bold", color=INK)
        text = f"j{joint} = {angle:.2f} rad, {letter} = {value:.2f} rad".replace("-", "−")
        ax.annotate(text, (0, -1.62), ha="center", fontsize=9.5, color=_COLOURS[letter])
    return figure


def _heading(vector: ArrayLike) -> float:
    x, y = np.asarray(vector, dtype=float)
    return math.atan2(y, x)


def _ray(axes: Axes, direction: ArrayLike, **line: Any) -> None:
    heading = _heading(direction)
    axes.plot([0, math.cos(heading)], [0, math.sin(heading)], **line)


def _sector(axes: Axes, centre: Floats, start: ArrayLike, end: ArrayLike, letter: str, *, radius: float) -> None:
    """Fill the angle counterclockwise from one direction to another."""
    first, last = math.degrees(_heading(start)), math.degrees(_heading(end))
    axes.add_patch(Wedge(tuple(centre), radius, first, last, color=_COLOURS[letter], alpha=0.7, lw=0))


def _right_angle(axes: Axes, corner: Floats, one: tuple[int, int], other: tuple[int, int]) -> None:
    size = 0.045
    path = corner + size * np.array([one, np.add(one, other), other])
    axes.plot(*path.T, color=INK, lw=1)

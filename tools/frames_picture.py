"""docs/images/frames.png: a UR5e with a tool, and the frames that poses are given in.

python -m tools.frames_picture
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from kinreach.kinematics import ArmKinematics
from kinreach.plots._style import INK
from kinreach.robots import ArmDescription, Tool, get_arm
from kinreach.robots._shapes import link_shapes

OUT = Path(__file__).resolve().parents[1] / "docs/images/frames.png"
#: Colours of the axes x, y and z.
COLOURS = ("#c23b22", "#2e8b57", "#2b5fa8")
#: Of the arm and of its tool.
LINK, TOOL = "#f4f5f8", "#bcd2f0"
POSTURE = np.radians([-60.0, -75.0, 95.0, -110.0, -90.0, 0.0])


def main() -> None:
    """Draw the frames of a UR5e with a tool."""
    arm = get_arm("ur5e").with_tool(Tool.tube([0.0, 0.0, 0.15, 0.0, 0.0, 0.0], 0.03))
    figure = Figure(figsize=(6.4, 5.2))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    faces, colours = [], []
    for shape in link_shapes(arm):
        T = ArmKinematics(arm_with_tip(arm, shape.link), tip="link", base="world").fk(POSTURE)
        corners = shape.vertices @ T[:3, :3].T + T[:3, 3]
        faces += list(corners[shape.faces])
        colours += [TOOL if shape.link == "tool_body" else LINK] * len(shape.faces)
    light = LightSource(azdeg=160.0, altdeg=50.0)
    axes.add_collection3d(
        Poly3DCollection(faces, facecolors=colours, edgecolors=colours, lw=0.3, shade=True, lightsource=light)
    )
    frames = {
        "base_link": (ArmKinematics(arm, base="base_link").T_world_base, 0.36),
        "base": (ArmKinematics(arm, base="base").T_world_base, 0.36),
        "tool0": (ArmKinematics(arm, tip="tool0", base="world").fk(POSTURE), 0.14),
        "tool": (ArmKinematics.of(arm, base="world").fk(POSTURE), 0.14),
    }
    for name, (T, length) in frames.items():
        for axis, colour, letter in zip(T[:3, :3].T, COLOURS, "xyz", strict=True):
            if (name, letter) == ("base", "z"):  # that of base_link
                continue
            axes.plot(*zip(T[:3, 3], T[:3, 3] + length * axis, strict=True), color=colour, linewidth=2.2, zorder=9)
            if (name, letter) == ("tool0", "z"):  # where the tool's x is
                continue
            text = f"{letter} {name}" if name.startswith("base") and letter != "z" else letter
            away = length + (0.09 if name.startswith("base") else 0.05)
            axes.text(*(T[:3, 3] + away * axis), text, color=colour, fontsize=10, ha="center", va="center", zorder=9)
    axes.text(*(frames["tool0"][0][:3, 3] + (0.0, 0.0, 0.05)), "   tool0 (flange)", color=INK, fontsize=11, zorder=9)
    axes.text(*(frames["tool"][0][:3, 3]), "     tool", color=INK, fontsize=11, zorder=9)
    axes.set_axis_off()
    axes.set_xlim(-0.45, 0.75)
    axes.set_ylim(-0.6, 0.6)
    axes.set_zlim(-0.1, 1.1)
    axes.set_box_aspect((1, 1, 1), zoom=1.45)
    axes.view_init(elev=22, azim=-50)
    figure.savefig(OUT, dpi=200, facecolor="white", bbox_inches=Bbox([[1.2, 0.45], [6.4, 3.65]]))


def arm_with_tip(arm: ArmDescription, link: str) -> ArmDescription:
    """Return the arm with another link as its tip."""
    return replace(arm, tips={"link": link}, default_tip="link")


if __name__ == "__main__":
    main()

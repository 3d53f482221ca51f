"""The Panda of Franka Emika: seven joints, so that a pose has a family of postures."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from kinreach.robots._description import ArmDescription
from kinreach.robots._meshes import HULLS
from kinreach.robots._ur_arms import example_robot_data
from kinreach.robots._workcell import Box, BoxRegion, Workcell

FLOOR = -0.75
BALL_RADIUS = 0.025


def describe() -> ArmDescription:
    """Describe the Panda with its hand closed, on the edge of a table with the goals.

    Raises:
        InstallationError: example-robot-data is not installed.
    """
    arm = ArmDescription.from_urdf(
        Path(example_robot_data()) / "example-robot-data/robots/panda_description/urdf/panda.urdf",
        name="panda",
        tip="panda_hand_tcp",
        meshes=HULLS,
        home=(0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4),
        workcell=Workcell(
            obstacles=(
                Box("table", (1.20, 1.40, 0.04), (0.40, 0.0, -0.02), legs=-0.04 - FLOOR),
                Box("floor", (6.0, 6.0, 0.10), (0.0, 0.0, FLOOR - 0.05)),
            ),
            touching=(("table", "panda_link0"),),
            goals=BoxRegion(x=(0.35, 0.65), y=(-0.30, 0.30), z=(BALL_RADIUS,) * 2),
            ball_radius=BALL_RADIUS,
        ),
    )
    return replace(arm, title="Panda", notes=())

import re
import sys
import types

import numpy as np
import pytest

from kinreach.envs.reach.task import TOOL_DOWN
from kinreach.kinematics import UR5Kinematics
from kinreach.sim import ArmSimulation

HEADED = 2  # lines of a table before its first row


@pytest.fixture
def ur5():
    return ArmSimulation("ur5")


@pytest.fixture(scope="session")
def tool_down():
    """Posture of the UR5 with the tcp at a point of the world [m], pointing down."""
    kinematics = UR5Kinematics(tip="tcp", base="world")

    def posture(position):
        result = kinematics.axis_goal(position, TOOL_DOWN, np.array(kinematics.arm.home))
        assert result.success, result.reason
        return result.q

    return posture


@pytest.fixture(scope="session")
def goals():
    """Goals of the UR5 [m]: the corners of the area first, then drawn ones."""
    region = ArmSimulation("ur5").arm.workcell.goals
    corners = [(x, y, region.z[0]) for x in region.x for y in region.y]
    return np.array([*corners, *region.sample(np.random.default_rng(7), 60)])


@pytest.fixture(scope="session")
def doc_tables():
    """`doc_tables(docstring, heading)`: the tables of a docstring's section, each a list of rows of cells."""

    def tables(docstring, heading):
        section = docstring.split(f"## {heading}")[1].split("\n    ## ")[0]
        found = [block.splitlines() for block in re.findall(r"(?:^    \|.*\n?)+", section, re.MULTILINE)]
        return [
            [[cell.strip() for cell in row.strip().strip("|").split("|")] for row in rows[HEADED:]] for rows in found
        ]

    return tables


@pytest.fixture
def films(monkeypatch):
    """The frames of each film that Gymnasium hands to moviepy, which is not installed here."""
    films = []

    class Clip:
        def __init__(self, frames, fps):
            films.append(list(frames))

        def write_videofile(self, *args, **kwargs):
            pass

    editor = types.ModuleType("moviepy.video.io.ImageSequenceClip")
    editor.ImageSequenceClip = Clip
    for name in ("moviepy", "moviepy.video", "moviepy.video.io"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, "moviepy.video.io.ImageSequenceClip", editor)
    return films

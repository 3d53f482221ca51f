"""Poses of the cameras that measure the goal."""

import pytest

from kinreach.robots import get_arm
from kinreach.vision._goal_view import goal_camera_poses


def test_poses_of_the_cameras_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        goal_camera_poses(get_arm("ur5-thesis"))[0, 0, 0] = 1.0

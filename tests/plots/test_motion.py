"""The picture of a motion: lines of angles and speeds, each joint named at the end of its line."""

import numpy as np

from kinreach.deploy._move_cli import draw_motion
from kinreach.kinematics import Trajectory


def test_joints_are_drawn_and_named_at_their_ends():
    t = np.linspace(0.0, 2.0, 5)
    ends = np.array([-2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
    q = ends * t[:, None] ** 2 / 4.0  # no sample but the last one is at the end
    qd = ends * t[:, None] / 2.0
    names = [*"abcdef"]
    figure = draw_motion(Trajectory(names, t, q, qd), np.full(6, 4.0), "a motion")
    angles, speeds = figure.axes
    drawn = np.array([line.get_ydata() for line in angles.lines[:6]])
    np.testing.assert_allclose(drawn, np.degrees(q).T)
    np.testing.assert_allclose([line.get_ydata() for line in speeds.lines[:6]], 25.0 * qd.T)
    assert angles.get_xlim() == speeds.get_xlim() == (0.0, 2.0)
    labels = {text.get_text(): text.xy[1] for text in angles.texts}
    assert list(labels) == names
    low, high = angles.get_ylim()
    expected = (np.degrees(ends) - low) / (high - low)
    np.testing.assert_allclose(list(labels.values()), expected, atol=1e-6)

"""What the thesis does not give: each world changes one thing."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from benchmarks.studies import thesis_unsaid
from benchmarks.studies.ppo2 import PLANS
from benchmarks.studies.thesis_unsaid import HEIGHT, WIDTH, area, higher, normalised, pixels
from kinreach.baselines._batch import first_observations
from kinreach.robots import get_arm
from kinreach.vision import Intrinsics


def test_areas_and_heights():
    goals = area(0.1).workcell.draw_goals(np.random.default_rng(0), 1000)
    assert np.ptp(goals, axis=0)[:2] == pytest.approx([0.1, 0.1], abs=0.002)
    assert goals.mean(axis=0)[:2] == pytest.approx([0.475, 0.0], abs=0.01)
    own = get_arm("ur5-thesis").workcell.draw_goals(np.random.default_rng(0), 100)
    up = higher(0.1).workcell.draw_goals(np.random.default_rng(0), 100)
    np.testing.assert_allclose(up - own, np.tile([0, 0, 0.1], (100, 1)), atol=1e-12)


def test_pixels_are_where_a_camera_has_the_ball():
    """Beside `Intrinsics.project` of what the other reading says, in metres."""
    stack = PLANS["single"].stack
    metres, image = (
        first_observations(stack.environment, {"backend": "kinematic", "goal_in": kind}, seed=0)[:50]
        for kind in ("camera", "image")
    )
    shift, scale = map(np.array, pixels(stack))
    seen, checked = (image - shift) / scale, 0
    for block, camera in enumerate(get_arm("ur5-thesis").goal_cameras):
        columns = slice(3 * block, 3 * block + 3)
        uv = Intrinsics.from_fovy(camera.fovy, WIDTH, HEIGHT).project(metres[:, columns])
        inside = (np.abs(image[:, columns][:, :2]) < 2.0).all(axis=1)
        np.testing.assert_allclose(seen[inside, 3 * block : 3 * block + 2], uv[inside], atol=1e-6)
        np.testing.assert_allclose(seen[:, 3 * block + 2], metres[:, 3 * block + 2], atol=1e-9)
        checked += int(inside.sum())
    assert checked >= 80
    np.testing.assert_array_equal(seen[:, 6:], metres[:, 6:])


def test_normalised_inputs_have_a_spread_of_one():
    stack = PLANS["single"].stack
    shift, scale = map(np.array, normalised(stack))
    z = (first_observations(stack.environment, {"backend": "kinematic"}, seed=0) - shift) / scale
    spread = z.std(axis=0)
    assert z.mean(axis=0) == pytest.approx(np.zeros(13), abs=1e-9)
    assert ((spread < 1e-9) | (np.abs(spread - 1.0) < 1e-9)).all()
    assert (spread > 0.5).sum() >= 4


def test_the_table_is_resumed(tmp_path, capsys, monkeypatch):
    arguments = ["--task", "single", "--steps", "256", "--out", str(tmp_path)]
    arguments += ["--worlds", "as in the other tables", "goals as pixels and depths", "one arm, 4096 steps"]
    monkeypatch.setattr(thesis_unsaid, "GOALS", 20)
    assert thesis_unsaid.main(arguments) == 0
    table = capsys.readouterr().out
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    assert [row[:3] for row in rows] == [
        ["single", "as in the other tables", "5"],
        ["single", "goals as pixels and depths", "5"],
    ]
    assert rows[0][4] != rows[1][4]
    monkeypatch.setattr(thesis_unsaid, "train_stack", None)  # nothing is trained again
    assert thesis_unsaid.main(arguments) == 0
    assert capsys.readouterr().out == table

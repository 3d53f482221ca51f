"""What the methods are told about a goal, with cameras that a stand-in plays: no OpenGL here."""

import inspect
import math
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
import pytest

from kinreach.compare.observation import CameraSettings, looking, true_position
from kinreach.compare.settings import MOST_SEED, Settings
from kinreach.compare.tasks import UR5Task
from kinreach.envs.reach.options import ReachOptions
from kinreach.errors import InputError, InstallationError, UnknownNameError
from kinreach.vision.goal_view import CameraGoalView


def test_the_geometric_observation_is_the_true_goal(task: UR5Task) -> None:
    goal = task.goals(1, 0)[0]
    with looking(task, None, 0) as look:
        assert look is true_position
    sight = true_position(3, goal)
    assert sight.look_s is None
    assert np.array_equal(sight.position, goal)


def test_the_defaults_are_those_of_the_view() -> None:
    defaults = {name: p.default for name, p in inspect.signature(CameraGoalView).parameters.items()}
    ours = CameraSettings()
    assert (ours.pipeline, ours.width, ours.height) == tuple(defaults[name] for name in ("pipeline", "width", "height"))
    assert (ours.rgb_noise, ours.depth_noise) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        (CameraSettings(), "hybrid pipeline, 640x360, no noise"),
        (CameraSettings("thesis", 1280, 720, 6.0, 0.002), "thesis pipeline, 1280x720, noise 6 levels, 2 mm"),
    ],
)
def test_in_words(camera: CameraSettings, words: str) -> None:
    assert str(camera) == words


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"width": 15}, r"width \[px\] must be at least 16, got 15"),
        ({"height": 16385}, r"height \[px\] must be at most 16384, got 16385"),
        ({"rgb_noise": -1.0}, "rgb_noise must be finite and at least 0 and at most 255, got -1"),
        ({"rgb_noise": 255.5}, "rgb_noise must be"),
        ({"rgb_noise": float("nan")}, "rgb_noise"),
        ({"depth_noise": 1.1}, "depth_noise must be finite and at least 0 and at most 1, got 1.1"),
        ({"depth_noise": float("inf")}, "depth_noise"),
        ({"depth_noise": True}, "depth_noise must be a number, got True"),
    ],
)
def test_what_cannot_be_is_refused(wrong: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        CameraSettings(**wrong)  # type: ignore[arg-type]


def test_the_cameras_of_a_comparison_may_be_what_those_of_an_environment_may_be() -> None:
    """The same values are refused with the same words; for values at, around and far from every bound."""
    values: dict[str, list[Any]] = {
        "pipeline": ["hybrid", "thesis", "magic", None, 1],
        "width": [-1, 0, 15, 16, 640, 16384, 16385, 20000, 2**63, 640.0, True, "640"],
        "rgb_noise": [-1e-9, -0.0, 0, 6, 254.9, 255, 255.5, 256, math.nan, math.inf, True, "6", None],
        "depth_noise": [-1e-9, 0.0, 0.002, 0.999, 1, np.float32(1), 1.0000001, -math.inf, math.nan, False, None],
    }
    values["height"] = values["width"]
    defaults = asdict(CameraSettings())
    assert set(values) == set(defaults)
    refused = 0
    for name, case in [(option, each) for option in values for each in values[option]]:
        said = []
        options = {**defaults, name: case}
        for make in (CameraSettings, partial(ReachOptions, "camera", "kinematic")):
            try:
                make(**options)
                said.append("")
            except InputError as error:
                said.append(str(error))
        assert said[0] == said[1], (name, case)
        refused += bool(said[0])
    assert refused == 35


def test_an_unknown_pipeline_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown pipeline 'magic'; available: hybrid, thesis"):
        CameraSettings(pipeline="magic")


def test_the_view_looks_at_the_goal_from_the_start_posture_and_is_closed(task: UR5Task, stand_in: Any) -> None:
    goals = task.goals(4, 0)
    with looking(task, CameraSettings("thesis", 320, 180, 6.0, 0.002), 0) as look:
        sights = [look(index, goal) for index, goal in enumerate(goals)]
        (view,) = stand_in.made
        assert not view.closed
    assert view.closed
    assert (view.width, view.height, view.pipeline) == (320, 180, "thesis")
    assert (view.noise.rgb_sigma, view.noise.depth_sigma) == (6.0, 0.002)
    assert len(view.looks) == 1 + len(goals)  # one untimed look before
    for (q, ball), goal, sight in zip(view.looks[1:], goals, sights, strict=True):
        assert np.array_equal(q, task.home)
        assert np.array_equal(ball, goal)
        assert sight.look_s is not None
        assert 0 < sight.look_s < 1
        np.testing.assert_allclose(sight.position, goal, atol=1e-12)
    assert not any(np.array_equal(view.looks[0][1], goal) for goal in goals)


@pytest.mark.parametrize("seed", [0, 2**32 - 1, MOST_SEED])
def test_no_seed_of_a_comparison_draws_the_goal_of_the_warm_up(task: UR5Task, stand_in: Any, seed: int) -> None:
    assert Settings(seed=seed).seed == seed
    with looking(task, CameraSettings(), seed):
        (view,) = stand_in.made
    ((_, ball),) = view.looks
    assert len(task.goals(3, seed)) == 3
    assert not any(np.array_equal(ball, goal) for goal in task.goals(3, seed))


def test_the_noise_of_a_goal_depends_on_seed_and_index_alone(task: UR5Task, stand_in: Any) -> None:
    stand_in.sigma = 0.001
    goal = task.goals(1, 0)[0]

    def seen(seed: int, *indices: int) -> list[tuple[float, ...]]:
        with looking(task, CameraSettings(), seed) as look:
            return [tuple(np.array(look(index, goal).position)) for index in indices]

    first = seen(0, 0, 1, 2)
    assert len(set(first)) == 3
    assert seen(0, 2, 1, 0) == first[::-1]
    assert seen(0, 1) == first[1:2]
    assert not set(seen(1, 0, 1, 2)) & set(first)


def test_one_camera_is_enough_and_none_is_no_goal(task: UR5Task, stand_in: Any) -> None:
    goals = task.goals(2, 0)
    with looking(task, CameraSettings(), 0) as look:
        stand_in.found = (False, True)
        np.testing.assert_allclose(look(0, goals[0]).position, goals[0], atol=1e-12)
        stand_in.found = (False, False)
        blind = look(1, goals[1])
    assert blind.position is None
    assert blind.look_s is not None


def test_without_a_graphics_library_nothing_is_looked_at(task: UR5Task, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_library() -> None:
        raise InstallationError("apt install libegl1 libgl1")

    monkeypatch.setattr("kinreach.sim.rendering._choose_library", no_library)
    with pytest.raises(InstallationError, match="libegl1"), looking(task, CameraSettings(), 0):
        pytest.fail("the context was entered")

"""placo with weights on an arm of five axes: what it settles on has the smallest weighted error near the start."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinreach._registration import SINGLE, SPACE
from kinreach.compare import get_task
from kinreach.compare._methods import weighted
from kinreach.compare._methods.weighted import WeightedPlaco
from kinreach.kinematics import AxisGoal, PositionGoal

pytestmark = pytest.mark.usefixtures("needs_placo")
#: LeRobot's weights, of each metre and of each radian that is left, squared.
WEIGHTS = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])
#: Environments, their options, and the goals that a solver gets there.
WORLDS = {"ur5": (SINGLE, {}, PositionGoal), "space": (SPACE, {"tilt": 30.0}, AxisGoal)}


@pytest.fixture(params=WORLDS)
def world(request):
    name, options, kind = WORLDS[request.param]
    with gym.make(name, arm="so101", backend="kinematic", **options) as env:
        yield env, kind


def test_arms_of_four_and_five_joints_have_it():
    for task in ("ur5", "space"):
        of_arms = get_task(task).arm_methods
        assert [name for name in (4, 5) if of_arms[name]["placo-weights"].make is WeightedPlaco] == [4, 5]


def test_no_joint_that_can_move_would_lower_the_weighted_error(world):
    """The gradient is 0, but for joints at a limit, which it pushes outwards; distances are those that are left."""
    env, kind = world
    method, kin, settled, inside = WeightedPlaco(env), env.unwrapped.kinematics, 0, 0
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        method.reset(observation, info)
        goal, R = env.unwrapped.ik_goal(info["seen"]), kin.fk(info["q"])[:3, :3]
        assert type(goal) is kind
        if kind is AxisGoal:  # the shortest turn to the goal's direction
            across = np.cross(R[:, 2], goal.axis)
            angle = np.arctan2(np.linalg.norm(across), R[:, 2] @ goal.axis)
            R = Rotation.from_rotvec(angle * across / np.linalg.norm(across)).as_matrix() @ R
        *_, after = env.step(method.act(observation))
        if after["impossible"]:
            continue
        q = after["q"]
        T = kin.fk(q)
        left = np.concatenate([goal.position - T[:3, 3], Rotation.from_matrix(R @ T[:3, :3].T).as_rotvec()])
        downhill = kin.jacobian(q).T @ (WEIGHTS * left)
        low, high = q < kin.lower + 1e-9, q > kin.upper - 1e-9
        assert np.abs(downhill[~low & ~high]).max() < 1e-8
        assert (downhill[low] < 0.0).all()
        assert (downhill[high] > 0.0).all()
        assert 1e-6 < after["distance"] < 0.03
        assert after["distance"] == pytest.approx(np.linalg.norm(left[:3]), abs=1e-9)
        assert 5 <= method.diagnostics["iterations"] < 20
        settled, inside = settled + 1, inside + np.count_nonzero(~low & ~high)
    assert settled >= 3
    assert inside >= 4 * settled


def test_it_stops_after_its_steps_or_where_the_program_fails(world, monkeypatch):
    """The action is then that of the posture so far, and each step goes on from the one before."""
    env, _ = world
    method = WeightedPlaco(env)
    observation, info = env.reset(seed=0)

    def after(steps):
        monkeypatch.setattr(weighted, "MAX_STEPS", steps)
        method.reset(observation, info)
        return method.act(observation), method.diagnostics

    start = env.unwrapped.action_for(np.asarray(info["q"]))
    actions = [after(steps) for steps in range(4)]
    np.testing.assert_array_equal(actions[0][0], start)
    assert [found["iterations"] for _, found in actions] == [0, 1, 2, 3]
    moved = [np.abs(one[0] - other[0]).max() for one, other in pairwise(actions)]
    assert min(moved) > 1e-6

    class Failing:
        """Fails at the third step."""

        def __init__(self, solver):
            self.solver, self.called = solver, 0

        def solve(self, apply):
            self.called += 1
            if self.called == 3:
                raise RuntimeError("NaN in the program")
            return self.solver.solve(apply)

    monkeypatch.setattr(method, "_solver", Failing(method._solver))
    action, found = after(200)
    assert found == {"iterations": 2}
    np.testing.assert_allclose(action, actions[2][0], atol=1e-6)


def test_it_says_that_no_camera_found_the_ball(world):
    env, _ = world
    method = WeightedPlaco(env)
    observation, info = env.reset(seed=0)
    assert (method.reason, method.diagnostics) == ("", {})
    for unseen in (np.full(3, np.nan), np.array([0.2, np.inf, 0.0])):
        method.reset(observation, {**info, "seen": unseen})
        assert method.act(observation) is None
        assert method.reason == "no camera found the ball"
    method.reset(observation, info)
    assert method.act(observation).shape == (5,)

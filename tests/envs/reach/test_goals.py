"""Goals drawn ahead for many environments are those that each would draw alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from kinreach.envs._batch import GoalStreams, goal_streams
from kinreach.envs.inside import with_goals
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, AxisGoal, CollisionChecker, QPSolver
from kinreach.robots import ArmDescription, Box, Workcell, get_arm

REGION = get_arm("ur5-thesis").workcell.goals


@pytest.mark.parametrize("count", [1, 5, 300])
def test_each_sequence_is_what_its_own_generator_draws(count):
    streams = GoalStreams(REGION, count)
    for index in range(count):
        streams.seed(index, np.random.default_rng(index))
    chance = np.random.default_rng(0)
    drawn = [[] for _ in range(count)]
    for turn in range(600):  # all at once, some of them, and now and then one that starts afresh
        ids = np.arange(count) if turn % 3 == 0 else np.flatnonzero(chance.random(count) < 0.7)
        for index, goal in zip(ids, streams.draw(ids), strict=True):
            drawn[index].append(goal)
        if turn == 100:
            streams.seed(0, np.random.default_rng(0))
            drawn[0].clear()
    for index, goals in enumerate(drawn):
        np.testing.assert_array_equal(goals, REGION.sample(np.random.default_rng(index), len(goals)))
    assert min(map(len, drawn)) > 256  # more than are drawn at a time


def test_goals_that_were_drawn_stay_as_they_are():
    streams = GoalStreams(REGION, 3)
    first = streams.draw(np.arange(3))
    kept = first.copy()
    for _ in range(300):
        streams.draw(np.arange(3))
    np.testing.assert_array_equal(first, kept)


def test_regions_of_any_shape_are_drawn_from():
    cell = get_arm("arm3").workcell
    streams = goal_streams(cell, 2)
    for index in range(2):
        streams.seed(index, np.random.default_rng(index))
    drawn = np.array([streams.draw(np.arange(2)) for _ in range(200)])
    for index in range(2):
        np.testing.assert_array_equal(drawn[:, index], cell.goals.sample(np.random.default_rng(index), 256)[:200])


def test_a_cell_without_goals_says_so_when_one_is_drawn():
    streams = goal_streams(Workcell(), 1)
    with pytest.raises(InputError, match="no goals"):
        streams.draw(np.arange(1))


ROBOTS = Path(str(get_arm("ur5-thesis").package_root())) / "example-robot-data/robots"


@pytest.mark.parametrize("file", ["xarm_description/urdf/xarm7.urdf", "ur_description/urdf/ur10_robot.urdf"])
@pytest.mark.slow
def test_an_arm_without_goals_is_given_some_of_its_size(file):
    bare = ArmDescription.from_urdf(ROBOTS / file)
    arm = with_goals(bare)
    assert with_goals(arm) is arm
    goals = arm.workcell.draw_goals(np.random.default_rng(0), 8)
    np.testing.assert_array_equal(goals, with_goals(bare).workcell.draw_goals(np.random.default_rng(0), 8))
    kin, checker = ArmKinematics(arm, base="world"), CollisionChecker(arm)
    q = np.random.default_rng(9).uniform(kin.lower, kin.upper, (5000, kin.n))
    reach = np.hypot(*kin.positions(q)[:, :2].T).max()
    away = np.hypot(*goals[:, :2].T) / reach
    assert ((away > 0.33) & (away < 0.77)).all()
    solver = QPSolver(kin)  # another one than the goals were tried with
    for goal in goals:
        result = solver.solve(AxisGoal(goal, (0.0, 0.0, -1.0)), arm.home, accept=checker.free)
        assert result.success
        np.testing.assert_allclose(kin.fk(result.q)[:3, 3], goal, atol=2e-4)
    assert len(goals) == 8


@pytest.mark.parametrize("model", ["ur10", "ur10e"])
def test_goals_are_where_no_obstacle_is(model):
    """A block fills half of the space about the arm, beside its base; the base of one is turned in the world."""
    bare = get_arm(model)
    if model == "ur10":
        bare = ArmDescription.from_urdf(ROBOTS / "ur_description/urdf/ur10_robot.urdf")
    block = Box("block", (3.0, 6.0, 3.0), (1.8, 0.0, 1.0))
    goals = {
        obstacles: with_goals(replace(bare, workcell=Workcell(obstacles=obstacles))).workcell.draw_goals(
            np.random.default_rng(0), 12
        )
        for obstacles in ((), (block,))
    }
    assert (goals[()][:, 0] > 0.3).sum() >= 3
    assert (goals[(block,)][:, 0] < 0.3).all()


def test_goals_that_nothing_reaches(monkeypatch):
    monkeypatch.setattr("kinreach.envs._reach.reachable_goals.MAX_TRIES", 3)
    monkeypatch.setattr("kinreach.envs._reach.reachable_goals.MAX_SHARE", 0.0)
    arm = with_goals(ArmDescription.from_urdf(ROBOTS / "xarm_description/urdf/xarm7.urdf"))
    with pytest.raises(InputError, match="no goal that arm 'UF_ROBOT' reaches"):
        arm.workcell.draw_goals(np.random.default_rng(0), 1)

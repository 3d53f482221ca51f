"""Reaching with arms of four and five joints: goals that they reach, and what is the same as with six."""

import re
from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import kinreach  # noqa: F401 (registers the environments)
from kinreach._registration import SPACE
from kinreach.baselines import rollout
from kinreach.baselines.inside import SolverPolicy
from kinreach.envs._reach import space
from kinreach.errors import InputError
from kinreach.kinematics import AxisGoal, ClosedFormSolver, CollisionChecker, FiveAxisKinematics
from kinreach.robots import ArmDescription, BoxRegion, Workcell, get_arm
from tests.kinematics.five_axis_arms import FIGURES, urdf_of
from tests.robots.peoples_files import MASS

WIDE = {"tilt": 30.0, "start_spread": 0.3}
#: Goals of arms by their files, on the height of their base.
REGIONS = {
    "koch": BoxRegion(x=(0.15, 0.22), y=(-0.08, 0.08), z=(0.02, 0.02)),
    "px100": BoxRegion(x=(0.12, 0.20), y=(-0.08, 0.08), z=(0.02, 0.02)),
}


@pytest.fixture(scope="module", params=["so101", *REGIONS])
def arm(request, tmp_path_factory):
    """By name, or by a file of five or of four joints."""
    name = request.param
    if name not in REGIONS:
        return get_arm(name)
    file = tmp_path_factory.mktemp("arm") / f"{name}.urdf"
    shape = '<collision><geometry><sphere radius="0.02"/></geometry></collision>'
    link = rf'<link name="\1">{MASS}{shape}</link>'
    file.write_text(re.sub(r'<link name="(l[1-5])"/>', link, urdf_of(*FIGURES[name], name)))
    return ArmDescription.from_file(file, tip="tip", workcell=Workcell(goals=REGIONS[name]))


def make(arm, **options):
    return gym.make(SPACE, arm=arm, **options)


@pytest.mark.parametrize("tilt", [0.0, 30.0])
def test_goals_are_those_that_the_arm_reaches(arm, tilt):
    env = make(arm, backend="kinematic", tilt=tilt).unwrapped
    kin, checker = FiveAxisKinematics(arm, base="world"), CollisionChecker(arm)
    box = arm.workcell.goals.wider(0.0, above=0.25)
    rows, turned = np.column_stack([*env.starts(np.random.default_rng(0), 40).values()]), 0
    assert len(rows) == 40
    for goal, direction, seed in zip(rows[:, :3], rows[:, 3:6], rows[:, 6:], strict=True):
        assert all(low <= at <= high for at, (low, high) in zip(goal, (box.x, box.y, box.z), strict=True))
        assert np.degrees(np.arccos(-direction[2])) <= tilt + 0.01
        turned += direction[2] > -1.0
        found = kin.solve(AxisGoal(goal, direction), seed, accept=checker.free)
        assert found.success, found.reason
    assert turned == (40 if tilt else 0)


@pytest.mark.parametrize("options", [WIDE, {"steps": "multi"}, {"goal_env": True, **WIDE}])
def test_gymnasium_and_stable_baselines3_agree(arm, options):
    env = make(arm, backend="kinematic", **options).unwrapped
    check_env(env, skip_render_check=True)
    pytest.importorskip("stable_baselines3.common.env_checker").check_env(env, skip_render_check=True)
    joints = len(arm.joints)
    assert env.action_space.shape == (joints,)
    space = env.observation_space["observation"] if "goal_env" in options else env.observation_space
    assert space.shape == ((joints + 1,) if "goal_env" in options else (3 + 3 + joints + 1,))


@pytest.mark.parametrize(("backend", "count"), [("kinematic", 6), ("mujoco", 2)])
def test_a_batch_equals_single_environments(backend, count):
    options = {"arm": "so101", "backend": backend, **WIDE}
    batch = gym.make_vec(SPACE, num_envs=count, vectorization_mode="vector_entry_point", **options)
    singles, compared = [gym.make(SPACE, **options) for _ in range(count)], 0
    observations, _ = batch.reset(seed=3)
    for seed, (row, env) in enumerate(zip(observations, singles, strict=True), start=3):
        np.testing.assert_array_equal(env.reset(seed=seed)[0], row)
    for _ in range(2):
        actions = 0.1 * batch.action_space.sample()
        observations, rewards, *_ = batch.step(actions)
        for row, paid, action, env in zip(observations, rewards, actions, singles, strict=True):
            _, reward, *_ = env.step(action)
            np.testing.assert_allclose(reward, paid, rtol=0, atol=1e-10)
            np.testing.assert_allclose(env.reset()[0], row, rtol=0, atol=1e-10)
            compared += 1
    assert compared == 2 * count


def test_the_closed_form_reaches_every_goal_under_dynamics():
    env = make("so101", **WIDE)
    policy = SolverPolicy(ClosedFormSolver(env.unwrapped.kinematics), env)
    trials = list(rollout(env, policy, [{"seed": seed} for seed in range(20)]))
    assert sum(trial["reached"] for trial in trials) == 20
    assert max(trial["distance"] for trial in trials) < 1e-3
    assert all(0.3 < trial["move_s"] < 3.0 for trial in trials)  # as fast as its servos


@pytest.mark.slow
def test_a_region_that_is_out_of_reach_is_said():
    far = Workcell(goals=BoxRegion(x=(1.0, 1.1), y=(0.0, 0.1), z=(0.1, 0.1)))
    env = make(replace(get_arm("so101"), name="far", workcell=far), backend="kinematic")
    with pytest.raises(InputError, match="arm 'far' reaches none of 1000 goals in its region"):
        env.reset(seed=0)


def test_after_so_many_draws_a_region_is_out_of_reach(monkeypatch):
    """Each of them is another goal; none is nearer than what the arm reaches."""
    monkeypatch.setattr(space, "MAX_DRAWS", 3)
    far = BoxRegion(x=(0.9, 1.0), y=(-0.1, 0.1), z=(0.1, 0.1))
    arm = get_arm("so101")
    task = make(replace(arm, workcell=replace(arm.workcell, goals=far)), backend="kinematic", tilt=10.0).unwrapped._task
    asked = []
    kin = SimpleNamespace(
        axis_solutions=lambda place, axis, seed: asked.append(place) or SimpleNamespace(q=[], left=[]), fk=None
    )
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="reaches none of 3 goals in its region with the tool within 10 degrees"):
        task._nearest_aim(kin, task._aims(rng, 1, 0.0)[0], rng, 0.0)
    assert len(asked) == len(np.unique(asked, axis=0)) == 3

"""Actions that change the tip: it goes as far as asked, in the arm's branch, or as far as there is a posture."""

import gymnasium as gym
import numpy as np
import pytest

from kinreach._registration import PICK_AND_PLACE, PUSH
from kinreach.baselines.inside import PickAndPlaceScript, PushScript
from kinreach.envs._reach.reach_task import joint_limits
from kinreach.envs._tip_control import HALVINGS, MAX_TURN, MOVE, SMALL_STEP, TipControl
from kinreach.errors import InputError, UnknownNameError
from kinreach.robots import get_arm

CONTROLS = ("position", "pose")
REACH, PLANE, SINGLE, LIFT = (f"kinreach/{name}-v0" for name in ("Reach", "UR5MultiStep", "UR5SingleStep", "Lift"))
#: The smallest part of a way that is found.
LEAST = 0.5**HALVINGS


def control_of(arm, control):
    arm = get_arm(arm)
    return TipControl(arm, control, joint_limits(arm), MOVE, alone=False)


def angle(R):
    return np.arccos(np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1))


@pytest.mark.parametrize("arm", ["ur5-thesis", "ur10e", "ur3e"])
@pytest.mark.parametrize("control", CONTROLS)
def test_the_tip_goes_as_asked_or_as_far_as_there_is_a_posture(arm, control):
    """From postures all over the joints' range, many at the edge of reach and next to singularities."""
    tip, rng, count = control_of(arm, control), np.random.default_rng(7), 400
    kin, (lower, upper) = tip.kinematics, tip._limits
    q = rng.uniform(np.maximum(lower, -np.pi), np.minimum(upper, np.pi), (count, 6))
    q[: count // 4, 2] *= 0.02  # nearly straight
    q[count // 4 : count // 2, 4] *= 0.02  # wrists nearly in line
    start, side = kin.chain.fk(q), np.sign(np.linalg.det(kin.chain.jacobian(q)))
    actions = rng.uniform(-1, 1, (count, tip.size))
    found, share = tip.targets(q, actions, start[:, :3, :3])
    T = kin.chain.fk(found)
    assert (np.abs(found - q).max(axis=1) <= MAX_TURN).all()
    assert ((found >= lower) & (found <= upper)).all()
    np.testing.assert_array_equal(share, np.round(share / LEAST) * LEAST)
    moved = T[:, :3, 3] - start[:, :3, 3]
    np.testing.assert_allclose(moved, share[:, None] * MOVE[0] * actions[:, :3], atol=1e-6)
    turned = angle(T[:, :3, :3] @ start[:, :3, :3].swapaxes(1, 2))
    wanted = share * MOVE[1] * np.linalg.norm(actions[:, 3:], axis=1) if control == "pose" else 0.0
    np.testing.assert_allclose(turned, wanted, atol=2e-6)
    assert (np.sign(np.linalg.det(kin.chain.jacobian(found))) == side).all()
    stays = share == 0.0
    np.testing.assert_array_equal(found[stays], q[stays])
    # what was cut has no posture a 64th further on
    cut = np.flatnonzero(share < 1.0)
    part = share[cut] + LEAST
    on = tip._on_way(start, actions, start[:, :3, :3], cut, part)
    refused = 0
    for T_on, row in zip(on, cut, strict=True):
        others = kin.all_solutions(T_on, seed=q[row]).q
        near = others[(np.abs(others - q[row]) <= MAX_TURN).all(axis=1)]
        near = near[((near >= lower) & (near <= upper)).all(axis=1)]
        assert not (np.sign(np.linalg.det(kin.chain.jacobian(near))) == side[row]).any() if len(near) else True
        refused += 1
    assert refused >= 20
    assert (share == 1.0).sum() >= 150
    assert ((share > 0.0) & (share < 1.0)).sum() >= 5


@pytest.mark.parametrize("backend", ["kinematic", "mujoco"])
@pytest.mark.parametrize("control", CONTROLS)
def test_batches_do_what_single_environments_do_and_info_says_how_far(control, backend):
    given = {"steps": "multi", "control": control, "backend": backend, "dtype": "float64", "end_on_reached": False}
    count, steps, compared, cut = 4, 25 if backend == "kinematic" else 6, 0, 0
    batch = gym.make_vec(REACH, count, "vector_entry_point", **given)
    singles = [gym.make(REACH, disable_env_checker=True, **given) for _ in range(count)]
    seen, info = batch.reset(seed=5)
    for row, env in enumerate(singles):
        own, told = env.reset(seed=5 + row)
        np.testing.assert_array_equal(own, seen[row])
        assert told["tip_share"] == 0.0
    out = np.zeros((count, batch.single_action_space.shape[0]))
    out[:, :3] = np.random.default_rng(1).choice([-1.0, 1.0], (count, 3))  # out of reach at last
    for _ in range(steps):
        seen, *_, info = batch.step(out)
        for row, env in enumerate(singles):
            before = env.unwrapped.episodes.world.snapshot()[1][0]
            own, *_, told = env.step(out[row])
            np.testing.assert_allclose(own, seen[row], atol=1e-9)
            assert told["tip_share"] == info["tip_share"][row]
            if backend == "kinematic" and not told["impossible"]:
                np.testing.assert_allclose(told["tip"] - before, told["tip_share"] * MOVE[0] * out[row, :3], atol=1e-6)
            cut += told["tip_share"] < 1.0
            compared += 1
    assert compared == count * steps
    assert cut >= 10 or backend == "mujoco"
    assert (batch.reset(seed=6)[1]["tip_share"] == 0.0).all()  # nothing of the last episode
    assert all(env.reset()[1]["tip_share"] == 0.0 for env in singles)


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("name", [REACH, PLANE])
def test_the_action_towards_a_posture_reaches_it(name, control):
    options = {"steps": "multi"} if name == REACH else {}
    env = gym.make(name, backend="kinematic", control=control, **options)
    reached = 0
    for seed in range(8):
        _, info = env.reset(seed=seed)
        world = env.unwrapped
        q = world.kinematics.axis_goal(info["goal"], [0, 0, -1], seed=world.home).q
        over = False
        for _ in range(20):
            action = world.action_for(q)
            assert env.action_space.contains(action.astype(np.float32))
            np.testing.assert_allclose(world.posture_for(action), world.episodes.targets(action[None])[0][0])
            _, _, over, _, info = env.step(action)
            if over:
                break
        reached += info["reached"]
    assert reached >= 7


@pytest.mark.parametrize("name", [LIFT, PUSH])
def test_a_new_episode_knows_nothing_of_the_last_ones_ways(name):
    env = gym.make(name, control="position", **({"steps": "multi"} if name == LIFT else {}))
    env.reset(seed=0)
    *_, info = env.step(np.full(env.action_space.shape, 0.1, dtype=np.float32))
    assert info["tip_share"] > 0.0
    assert env.reset()[1]["tip_share"] == 0.0


@pytest.mark.parametrize("control", CONTROLS)
def test_the_tip_lifts_a_ball(control):
    """Down over it, close, and up; the directions of other axes are held."""
    env = gym.make(LIFT, steps="multi", control=control)
    _, info = env.reset(seed=0)
    place, over, closing = info["goal"], False, 0
    while not over:
        low = np.abs(info["tip"][:2] - place[:2]).max() < 0.004
        aim = place + np.array([0, 0, 0.0 if low else 0.06])
        if (low and abs(info["tip"][2] - place[2]) < 0.004) or closing:
            closing += 1
        action = np.zeros(env.action_space.shape)
        if closing:
            action[-1] = -1.0
            action[2] = float(closing > 25)
        else:
            action[:3] = np.clip((aim - info["tip"]) / 0.02, -1, 1)
        _, _, terminated, truncated, info = env.step(action)
        assert 0.0 <= info["tip_share"] <= 1.0
        over = terminated or truncated
    assert info["is_success"]


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("name", [PUSH, PICK_AND_PLACE, LIFT])
def test_small_steps_send_tips_as_far_as_asked(name, control):
    """In the air and at the edge of reach; the servos cover some 0.7 of it in the step."""
    count, steps, whole, cut, followed = 6, 40, 0, 0, []
    given = {"steps": "multi"} if name == LIFT else {}
    batch = gym.make_vec(name, count, "vector_entry_point", control=control, dtype="float64", **given)
    kin, episodes = batch.unwrapped.episodes.small_steps._tip.kinematics, batch.unwrapped.episodes
    _, info = batch.reset(seed=11)
    rng, size = np.random.default_rng(4), 3 if control == "position" else 6
    held = kin.chain.fk(info["q"])[:, :3, :3]
    ahead = rng.uniform(-1.0, 1.0, (count, size))
    ahead[:, :3] = [[1, 0, 0.5], [0, 1, 1], [-1, 0, 0.3], [0, -1, 1], [0.2, 0.1, 1], [0.3, 0.4, 0.2]]
    for _ in range(steps):
        actions = np.zeros((count, *batch.single_action_space.shape))
        actions[:, :size] = ahead * rng.uniform(0.5, 1.0, (count, 1))
        before = kin.chain.fk(info["q"])
        sent = kin.chain.fk(episodes.small_steps.targets(np.arange(count), info["q"], actions[:, :size]))
        _, _, terminated, truncated, info = batch.step(actions)
        assert not (terminated | truncated | info["impossible"]).any()
        share = info["tip_share"]
        way = share[:, None] * SMALL_STEP[0] * actions[:, :3]
        np.testing.assert_allclose(sent[:, :3, 3] - before[:, :3, 3], way, atol=1e-6)
        turned = angle(sent[:, :3, :3] @ before[:, :3, :3].swapaxes(1, 2))
        if control == "pose":
            np.testing.assert_allclose(
                turned, share * SMALL_STEP[1] * np.linalg.norm(actions[:, 3:6], axis=1), atol=2e-6
            )
        else:
            moved = share > 0.0
            np.testing.assert_allclose(sent[moved, :3, :3], held[moved], atol=1e-6)
        free = share == 1.0
        came = info["tip"] - before[:, :3, 3]
        followed += [*(np.sum(came * way, axis=1)[free] / np.sum(way**2, axis=1)[free])]
        whole, cut = whole + free.sum(), cut + (share < 1.0).sum()
    assert whole + cut == count * steps
    assert whole >= 60
    assert cut >= 30
    assert 0.6 < np.median(followed) < 0.8  # servos lag, and swing when the next way is shorter
    assert 0.4 < np.quantile(followed, 0.05) < np.quantile(followed, 0.95) < 1.4


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("name", [PUSH, PICK_AND_PLACE])
def test_batches_of_objects_are_single_environments(name, control):
    """Native batch and Gymnasium's own, bit for bit, over resets in between."""
    count, compared, resets = 3, 0, 0
    given = {"control": control, "max_episode_steps": 5, "goal_env": True}
    native = gym.make_vec(name, count, "vector_entry_point", autoreset_mode="NextStep", **given)
    sync = gym.make_vec(name, count, "sync", **given)
    seen = [batch.reset(seed=2) for batch in (native, sync)]
    native.action_space.seed(3)
    for _ in range(14):
        for key, values in seen[1][0].items():
            np.testing.assert_array_equal(seen[0][0][key], values)
        np.testing.assert_array_equal(seen[0][-1]["tip_share"], seen[1][-1]["tip_share"])
        for own, other in zip(seen[0][1:-1], seen[1][1:-1], strict=True):
            np.testing.assert_array_equal(own, other)
        actions = native.action_space.sample()
        seen = [batch.step(actions) for batch in (native, sync)]
        compared, resets = compared + count, resets + (seen[0][2] | seen[0][3]).sum()
    assert compared == 14 * count
    assert resets >= count


@pytest.mark.parametrize(
    ("name", "control", "script", "start"),
    [
        (PUSH, "position", PushScript, {}),
        (PUSH, "pose", PushScript, {}),
        (PICK_AND_PLACE, "position", PickAndPlaceScript, {"yaw": [0.0]}),  # the fingers cannot turn
        (PICK_AND_PLACE, "pose", PickAndPlaceScript, {}),
    ],
)
def test_scripts_solve_the_same_goals_by_changes_of_the_tip(name, control, script, start):
    env, reached = gym.make(name, control=control, dtype="float64"), 0
    policy = script(env)
    for seed in range(2):
        observation, info = env.reset(seed=seed, options=start)
        policy.reset(observation, info)
        over = False
        while not over:
            action = policy.act(observation)
            assert env.action_space.contains(action.astype(np.float32))
            observation, _, ended, cut, info = env.step(action)
            over = ended or cut
        reached += info["is_success"]
    assert reached == 2


def test_where_it_cannot_be():
    for name, options, error, said in (
        (SINGLE, {}, InputError, 'control="pose" is of environments with several steps'),
        (REACH, {}, InputError, 'with steps="multi": here an action is a posture'),
        (LIFT, {}, InputError, 'is for steps="multi"'),
        (REACH, {"steps": "multi", "arm": "panda"}, InputError, 'six joints with a closed form.*use control="joints"'),
        (PLANE, {"arm": "arm3"}, InputError, "arm 'arm3' is another"),
        (PUSH, {"arm": "so101"}, InputError, "arm 'so101' is another"),
    ):
        for make in (gym.make, lambda name, **given: gym.make_vec(name, 2, "vector_entry_point", **given)):
            with pytest.raises(error, match=said):
                make(name, control="pose", **options)
    for name in (PLANE, PUSH, PICK_AND_PLACE):
        with pytest.raises(UnknownNameError, match="unknown control 'ee'; available: joints, pose, position"):
            gym.make(name, control="ee")

"""The parts that training adds to stable-baselines3: schedules, ranks, pacing, groups, the learning curve."""

from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from scipy.stats import norm, rankdata

from kinreach.baselines import _batch, get_recipe, read_curve
from kinreach.baselines._batch import last_value
from kinreach.baselines._learning_curve import COLUMNS, TRACE_COLUMNS, LearningCurve, curve_csv
from kinreach.baselines._models import build
from kinreach.baselines._policies import paced
from kinreach.baselines._ranked_ppo import AdaptiveRate, Exploration, TriesVecEnv, normal_scores
from kinreach.baselines._rewards import REWARDS
from kinreach.baselines._training import _end_segment
from kinreach.envs._reach.reach_task import STEP_SIZE, action_range, layout_of
from kinreach.errors import InputError
from kinreach.robots import get_arm

SINGLE, MULTI = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0"


def batch(name, count, **options):
    return gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", backend="kinematic", **options)


def test_exploration_falls_on_a_straight_line_in_the_logarithm_and_is_held():
    schedule = Exploration(1.0, 0.01, 0.5)
    assert schedule.at(0) == 1.0
    assert schedule.at(0.25) == pytest.approx(0.1)
    assert schedule.at(0.5) == schedule.at(1) == pytest.approx(0.01)
    assert schedule.scaled(2).at(0.25) == pytest.approx(0.2)


def test_the_rate_follows_the_divergence_within_its_bounds():
    adaptive = AdaptiveRate(1e-3, 0.03, decay=0.2)
    assert adaptive.after(1e-3, 0.05) == pytest.approx(1e-3 / 1.3)
    assert adaptive.after(1e-3, 0.01) == pytest.approx(1.3e-3)
    assert adaptive.after(1e-3, 0.03) == 1e-3
    assert adaptive.after(1e-6, 1.0) == 1e-6
    assert adaptive.after(1e-2, 0.0) == 1e-2
    assert [adaptive.share(p) for p in (0, 0.8, 0.9, 1)] == pytest.approx([1, 1, 0.5, 0])
    assert AdaptiveRate(1e-3, 0.03).share(1.0) == 1.0


def test_normal_scores_agree_with_scipy_where_ranks_differ_and_share_ties():
    rng = np.random.default_rng(0)
    rewards = rng.normal(size=(500, 8))
    raw = norm.ppf((rankdata(rewards, axis=1) - 0.5) / 8)
    np.testing.assert_allclose(normal_scores(rewards), raw / raw.std(axis=1, keepdims=True), atol=1e-12)
    tied = rng.integers(0, 3, (500, 8)).astype(float)
    scores = normal_scores(tied)
    same = tied[:, :, None] == tied[:, None, :]
    assert same.sum() > 500 * 8
    np.testing.assert_array_equal((scores[:, :, None] == scores[:, None, :]), same)
    np.testing.assert_allclose(scores.mean(axis=1), 0, atol=0.3)
    np.testing.assert_array_equal(normal_scores(np.zeros((1, 8))), 0)


def test_pacing_arrives_in_equal_steps_as_few_as_can_be():
    rng = np.random.default_rng(1)
    ways = rng.uniform(-1.2, 1.2, (400, 6))
    fewest = np.ceil(np.abs(ways).max(axis=1) / STEP_SIZE)
    left, lengths = ways.copy(), []
    for _ in range(int(fewest.max())):
        actions = paced(left, STEP_SIZE)
        assert (np.abs(actions) <= 1).all()
        lengths.append(np.abs(actions).max(axis=1))
        left = left - STEP_SIZE * actions
    np.testing.assert_allclose(left, 0, atol=1e-12)
    lengths = np.array(lengths)
    np.testing.assert_array_equal((lengths > 1e-6).sum(axis=0), fewest)
    for column, steps in zip(lengths.T, fewest.astype(int), strict=True):
        np.testing.assert_allclose(column[:steps], column[0], rtol=1e-6)
    np.testing.assert_array_equal(paced(np.zeros(6), STEP_SIZE), 0)


def test_a_way_of_whole_steps_takes_no_step_more_for_a_rounding_error():
    """What is left after some steps of a way is whole steps but for rounding, on both sides."""
    checked = 0
    for steps in range(1, 33):
        for error in (-1e-9, 0.0, 1e-9):
            way = STEP_SIZE * (steps + error) * np.array([1.0, -0.5, 0.25, 0.0, 0.0, -1.0])
            assert np.abs(paced(way, STEP_SIZE)).max() == pytest.approx(1.0, abs=1e-8)
            checked += 1
    assert checked == 96


def test_training_rewards():
    rewards = np.array([-100.0, -40.0, 3.0])
    info = {
        "distance": np.array([0.1, 0.01, 0.0]),
        "posture_error": np.array([0.2, 0.0, 0.0]),
        "impossible": np.array([True, False, False]),
    }
    np.testing.assert_array_equal(REWARDS["own"](rewards, info), rewards)
    np.testing.assert_array_equal(REWARDS["floored"](rewards, info), [-30, -30, 3])
    expected = [-np.log(0.10001) - 1.0 - 200, -np.log(0.01001), -np.log(1e-5)]
    np.testing.assert_allclose(REWARDS["dense"](rewards, info), expected)


def around(beyond, arm="ur5-thesis"):
    """Goals on the table area and around it."""
    region = get_arm(arm).workcell.goals.wider(beyond)
    return lambda rng, count: {"goal": region.sample(rng, count)}


@pytest.mark.parametrize(("name", "steps"), [(SINGLE, 1), (MULTI, 16)])
def test_groups_share_goals_and_are_rewarded_for_where_they_end(name, steps):
    options = {} if steps == 1 else {"end_on_reached": False}
    env = TriesVecEnv(
        batch(name, 64, **options),
        tries=8,
        draw=around(0.02),
        steps=steps,
        reward=REWARDS["dense"],
        blur=0.0,
    )
    env.seed(3)
    first = env.reset()
    env.seed(3)
    np.testing.assert_array_equal(first, env.reset())
    groups = first.reshape(8, 8, 13)
    np.testing.assert_array_equal(groups, np.repeat(groups[:, :1], 8, axis=1))
    assert len(np.unique(groups[:, 0, 0])) == 8
    home = np.array(get_arm("ur5-thesis").home) / np.pi
    after, rewards, dones, _ = env.step(np.tile(home, (64, 1)))
    assert dones.all()
    assert len(np.unique(rewards.round(4))) == 8
    assert not np.array_equal(after, first)
    np.testing.assert_array_equal(after[:, 6:12], first[:, 6:12])


@pytest.mark.parametrize(("name", "walk"), [("ranked-single", 1), ("ranked-multi", 16)])
def test_goals_of_training_are_from_around_the_table_area_as_the_recipe_says(name, walk):
    area, rng, drawn = get_arm("ur5-thesis").workcell.goals, np.random.default_rng(0), 0
    assert (get_recipe(name).beyond, get_recipe(name).walk) == (0.02, walk)
    for beyond, steps in ((0.02, walk), (0.0, 1), (0.1, 3)):
        env = build(replace(get_recipe(name), num_envs=8, beyond=beyond, walk=steps), 0, steps=8).env
        assert env._steps == steps
        goals = env._draw(rng, 4000)["goal"]
        for axis, (low, high) in enumerate((area.x, area.y)):
            np.testing.assert_allclose(goals[:, axis].min(), low - beyond, atol=1e-3)
            np.testing.assert_allclose(goals[:, axis].max(), high + beyond, atol=1e-3)
        drawn += len(goals)
        env.close()
    assert drawn == 12_000


@pytest.mark.parametrize("arm", ["ur5-thesis", "panda"])
def test_walking_ends_where_one_step_ends(arm):
    rng = np.random.default_rng(0)
    half, middle = action_range(get_arm(arm))
    home = np.array(get_arm(arm).home)
    postures = (home + rng.uniform(-0.3, 0.3, (64, len(home))) - middle) / half
    outcomes = []
    for name, steps, options in ((SINGLE, 1, {}), (MULTI, 16, {"end_on_reached": False})):
        env = TriesVecEnv(
            batch(name, 64, arm=arm, **options),
            tries=8, draw=around(0.02, arm), steps=steps, reward=REWARDS["dense"], blur=0.0,
            layout=layout_of(get_arm(arm)), arm=arm,
        )  # fmt: skip
        env.seed(5)
        env.reset()
        outcomes.append(env.step(postures)[1])
    possible = outcomes[0] > -100
    assert possible.sum() > 40
    np.testing.assert_allclose(outcomes[0][possible], outcomes[1][possible], atol=1e-5)


@pytest.mark.slow
def test_blur_is_shared_within_a_group_and_has_its_size():
    env = TriesVecEnv(
        batch(SINGLE, 4096), tries=8, draw=lambda rng, n: {"goal": np.tile([0.4, 0.0, -0.175], (n, 1))}, steps=1,
        reward=REWARDS["dense"], blur=1e-3,
    )  # fmt: skip
    env.seed(0)
    groups = env.reset().reshape(512, 8, 13)
    assert (groups == groups[:, :1]).all()
    assert groups[:, 0, :6].std(axis=0) == pytest.approx(np.full(6, 1e-3), rel=0.15)
    assert (groups[:, 0, 6:] == groups[0, 0, 6:]).all()


def test_the_learning_curve_counts_what_a_loop_counts():
    env = LearningCurve(batch(MULTI, 16), window=160, trace_after=320)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    rewards, impossible, lasts, returns = [], [], [], np.zeros(16)
    ended = []
    for step in range(230):
        _, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, (16, 6)))
        rewards.append(reward)
        impossible.append(info["impossible"])
        returns += reward
        over = terminated | truncated
        ended += [(step, returns[index], info["distance"][index]) for index in np.flatnonzero(over)]
        returns[over] = 0
    assert len(env.rows) == 23
    assert env.steps == 230 * 16
    assert env.episodes == len(ended) >= 32
    for row, values in enumerate(env.rows):
        found = dict(zip(COLUMNS, values, strict=True))
        window = slice(10 * row, 10 * row + 10)
        assert found["steps"] == 160 * (row + 1)
        assert found["reward"] == pytest.approx(np.mean(rewards[window]))
        assert found["impossible"] == pytest.approx(np.mean(impossible[window]))
        lasts = [(r, d) for s, r, d in ended if window.start <= s < window.stop]
        if lasts:
            assert found["return"] == pytest.approx(np.mean([r for r, _ in lasts]))
            assert found["distance"] == pytest.approx(np.mean([d for _, d in lasts]))
        else:
            assert found["return"] is None
    assert env.traced
    assert len(env.trace) == 100
    assert env.trace[0][0] > 320


def test_what_was_reached_lately_is_of_the_last_row_in_which_an_episode_ended():
    env = LearningCurve(batch(SINGLE, 4), window=8)
    assert env.reached_lately == 0.0
    place = COLUMNS.index("reached")
    for share, lately in ((None, 0.0), (0.25, 0.25), (0.75, 0.75), (None, 0.75), (0.5, 0.5)):
        env.rows.append([share if column == place else 0.0 for column in range(len(COLUMNS))])
        assert env.reached_lately == lately


@pytest.mark.parametrize(("after", "first"), [(0, 4), (7, 8), (8, 12), (9, 12), (12, 16)])
def test_the_traced_episode_begins_after_so_many_steps(after, first):
    """Of four environments whose episodes have one step each: the first one that ends with more steps than those."""
    env = LearningCurve(batch(SINGLE, 4), window=8, trace_after=after)
    env.reset(seed=0)
    seen = []
    for _ in range(6):
        _, rewards, _, _, info = env.step(np.random.default_rng(len(seen)).uniform(-1.0, 1.0, (4, 6)))
        seen.append([env.steps, info["final_info"]["distance"][0], rewards[0]])
        assert env.traced == (env.steps >= first)
    assert env.trace == [pytest.approx(row) for row in seen if row[0] == first]


def test_an_episode_is_traced_where_there_is_no_distance():
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    batch = gym.make_vec("CartPole-v1", 2, vectorization_mode="sync", vector_kwargs=same_step)
    curve = LearningCurve(batch, window=100, trace_after=5)
    curve.reset(seed=0)
    while not curve.traced:
        curve.step(np.ones(2, dtype=np.int64))
    curve.close()
    steps, distances, rewards = zip(*curve.trace, strict=True)
    assert len(steps) > 5
    assert set(distances) == {None}
    assert set(rewards) == {1.0}
    assert curve_csv(curve.trace, TRACE_COLUMNS).splitlines()[1] == f"{steps[0]},,1"


def test_a_reset_ends_the_episodes_in_progress_only():
    env = LearningCurve(batch(MULTI, 8, end_on_reached=False), window=8)
    for _ in range(3):
        env.reset(seed=0)
    assert env.episodes == 0
    env.step(np.zeros((8, 6)))
    env.reset()
    assert env.episodes == 8


def test_learning_curves_survive_the_file(tmp_path):
    rows = [[1, 2, 0.5, None, None, 0.1, 0.2, 0.0], [2, 4, 0.25, 3.0, 1.0, 0.1, 0.2, 1.0]]
    (tmp_path / "curve.csv").write_text(curve_csv(rows))
    read = read_curve(tmp_path / "curve.csv")
    assert list(read) == list(COLUMNS)
    np.testing.assert_array_equal(np.column_stack(list(read.values())), np.array(rows, dtype=float))
    (tmp_path / "bad.csv").write_text("steps,reward\n1,two\n")
    for name in ("bad.csv", "missing.csv"):
        with pytest.raises(InputError, match="learning curve"):
            read_curve(tmp_path / name)


def test_what_a_step_came_to_is_found_after_a_reset_in_the_same_step():
    """Gymnasium's own batches then keep it in `final_info`, for the environments that were reset."""
    step, ended = np.array([1.0, 2.0, 3.0]), np.array([False, True, False])
    np.testing.assert_array_equal(last_value({"distance": step}, "distance"), step)
    final = {"distance": np.array([0.0, 5.0, 0.0]), "is_success": ended}
    info = {"distance": step, "final_info": final, "_final_info": ended}
    np.testing.assert_array_equal(last_value(info, "distance"), [1.0, 5.0, 3.0])
    np.testing.assert_array_equal(last_value(info, "is_success"), ended)  # a reset has none
    assert last_value(info, "time") is None


def test_episodes_that_a_segment_cuts_off_are_cut_off_in_the_replay_buffer():
    """Those that had ended are not."""
    timeouts = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    buffer = SimpleNamespace(pos=2, dones=np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]), timeouts=timeouts)
    cuts = []
    curve, model = SimpleNamespace(cut=lambda: cuts.append(1)), SimpleNamespace(replay_buffer=buffer)
    _end_segment(SimpleNamespace(curve=curve, model=model))
    np.testing.assert_array_equal(timeouts, [[0.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    assert cuts == [1]


@pytest.mark.slow
def test_environments_of_the_first_observations_are_closed(closings):
    closed = closings(_batch, "_make")
    observations = _batch.first_observations("kinreach/Reach-v0", {"backend": "kinematic"}, seed=0)
    assert len(observations) == _batch.SAMPLE
    assert sum(close.call_count for close in closed) == 1

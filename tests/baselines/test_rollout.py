"""The loop between policies and environments, where these are anybody's."""

import zlib
from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import kinreach  # noqa: F401 (registers the environments)
from kinreach._registration import MOVING, SINGLE
from kinreach._statistics import success_columns
from kinreach.baselines import RandomPolicy, _loop, _solver_policy, evaluate, load_policy, rollout
from kinreach.baselines._loop import FunctionPolicy, flat, rollout_batch
from kinreach.baselines.inside import SolverPolicy, as_policy
from kinreach.compare._lift import GraspPolicy
from kinreach.envs._lift.lift_task import FACES, IS_CUBE, SEEN, SIZE
from kinreach.errors import InputError
from kinreach.kinematics import IKResult


def test_whoever_watches_gymnasiums_own_batch_sees_the_last_observations():
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    env = gym.make_vec(MOVING, 3, vectorization_mode="sync", vector_kwargs=same_step)
    seen = []
    trials = rollout_batch(
        env,
        FunctionPolicy(lambda observation: np.zeros((3, 6))),
        seed=0,
        watch=lambda observations, rewards, info, first: seen.append(np.array(observations)),
    )
    env.close()
    steps = [trial["steps"] for trial in trials]
    assert len(set(steps)) > 1
    assert len(seen) == max(steps)
    for index, trial in enumerate(trials):
        np.testing.assert_allclose(seen[trial["steps"] - 1][index, 4:10], trial["q"], atol=1e-12)


@pytest.mark.parametrize("observation", [np.zeros(3, np.uint8), np.zeros(5, np.float16), np.ones(7, np.bool_), 3])
def test_chance_takes_observations_of_any_size(observation):
    policy = RandomPolicy(gym.spaces.Box(-1.0, 1.0, (2,)), seed=1)
    drawn = []
    for _ in range(2):
        policy.reset(observation, {})
        drawn.append(policy.act(observation))
    np.testing.assert_array_equal(*drawn)


def test_chance_draws_what_it_drew_in_earlier_versions():
    """Seeded by numpy's hash of the seed and of the observation: its words of 32 bits, or the CRC of odd bytes."""
    space, twin = (gym.spaces.Box(-1.0, 1.0, (3,)) for _ in range(2))
    rng, drawn = np.random.default_rng(0), []
    cases = [rng.normal(size=5), rng.normal(size=3).astype(np.float32), np.arange(7, dtype=np.uint8)]
    cases.append({"pixels": np.arange(16, dtype=np.uint8), "numbers": rng.normal(size=2)})
    for seed in (0, 4):
        policy = RandomPolicy(space, seed=seed)
        for observation in cases:
            if isinstance(observation, dict):
                words = [zlib.crc32(part.tobytes()) for part in observation.values()]
            elif observation.nbytes % 4:
                words = [zlib.crc32(observation.tobytes())]
            else:
                words = [
                    int.from_bytes(observation.tobytes()[k : k + 4], "little") for k in range(0, observation.nbytes, 4)
                ]
            twin.seed(int(np.random.SeedSequence([seed, *words]).generate_state(1)[0]))
            policy.reset(observation, {})
            for _ in range(2):
                drawn.append(policy.act(observation))
                np.testing.assert_array_equal(drawn[-1], twin.sample())
    assert len(np.unique(drawn, axis=0)) == 2 * 2 * len(cases)


def test_an_evaluation_has_what_each_episode_says():
    found = evaluate(load_policy("button-report"), goals=3)
    said = [{"reached": True, "impossible": False}, {"reached": False, "impossible": True}]
    made_up = replace(found, trials=[{**found.trials[0], **one} for one in said])
    assert made_up.reached.tolist() == [True, False]
    assert made_up.impossible.tolist() == [False, True]


def test_a_distance_that_is_no_number_is_no_success():
    columns = success_columns(lambda trial: trial["completed"])
    near, nowhere, unknown = ({"completed": True, **said} for said in ({"distance": 1e-4}, {"distance": None}, {}))
    assert [column.of(near) for column in columns] == [True] * len(columns)
    assert [column.of(nowhere) for column in columns] == [False] * len(columns)
    assert [column.of(unknown) for column in columns] == [None] * len(columns)


class Clock:
    """A clock that only those whom it is given to advance."""

    def __init__(self):
        self.now = 100.0

    def perf_counter(self):
        return self.now


def test_a_trial_has_the_times_of_its_decisions(monkeypatch):
    """Of the solver, which is begun anew for every goal, and within it of the acceptance tests."""
    clock, env = Clock(), gym.make(SINGLE, backend="kinematic")
    for module in (_loop, _solver_policy):
        monkeypatch.setattr(module, "time", clock)
    accept = env.unwrapped.accept

    def slow(q):
        clock.now += 0.25
        return accept(q)

    class Solver:
        def solve(self, goal, seed, *, accept):
            clock.now += 1.0
            found = [accept(seed), accept(seed + 0.01)]
            return IKResult.of(env.unwrapped.kinematics, goal, seed, iterations=len(found))

    monkeypatch.setattr(env.unwrapped, "accept", slow)
    policy = SolverPolicy(Solver(), env)
    begin = policy.reset
    monkeypatch.setattr(policy, "reset", lambda *given: (setattr(clock, "now", clock.now + 8.0), begin(*given)))
    step = env.unwrapped.step
    monkeypatch.setattr(
        env.unwrapped, "step", lambda action: (setattr(clock, "now", clock.now + 64.0), step(action))[1]
    )
    (trial,) = rollout(env, policy, [{"seed": 0}])
    assert (trial["solve_s"], trial["accept_s"], trial["candidates"], trial["iterations"]) == (9.5, 0.5, 2, 2)
    env.close()


@pytest.mark.parametrize("env_name", [SINGLE, MOVING])
def test_watchers_see_the_reset_and_every_step(env_name):
    env, seen = gym.make(env_name), []
    (trial,) = rollout(
        env, as_policy(lambda observation: np.zeros(6)), [{"seed": 1}], watch=lambda *call: seen.append(call)
    )
    assert [each[0] for each in seen] == [env] * (trial["steps"] + 1)
    assert flat(seen[-1][1]).items() <= trial.items()
    env.close()


def test_a_trial_is_of_plain_values():
    info = {
        "q": np.array([1.0, 2.0]), "flags": np.array([True, False]), "lost": np.array([1.0, np.nan]), "deep": {"a": 1},
        "distance": np.float32(0.5), "far": np.inf, "count": np.int64(3), "is_success": np.True_, "zero": np.array(2.0),
        "table": np.eye(2, dtype=int), "text": "so", "other": object(),
    }  # fmt: skip
    assert flat(info) == {
        "q": [1.0, 2.0], "flags": [True, False], "lost": None, "distance": 0.5, "far": None, "count": 3, "zero": 2.0,
        "is_success": True, "table": [1, 0, 0, 1], "text": "so", "other": None, "reached": True, "impossible": False,
        "status": "completed",
    }  # fmt: skip
    assert flat({}) == {"reached": False, "impossible": False, "status": "missed"}
    assert type(flat(info)["count"]) is int


def test_what_acts_is_a_policy_and_nothing_else():
    model = SimpleNamespace(predict=lambda observation, deterministic: ((observation, deterministic), None))
    acting = SimpleNamespace(act=lambda observation: -observation)
    whole = RandomPolicy(gym.spaces.Discrete(3))
    assert as_policy(model).act(2) == (2, True)
    assert as_policy(acting).act(2) == -2
    assert as_policy(abs).act(-3) == 3
    assert as_policy(whole) is whole
    for given in (3, None, "ranked-single", SimpleNamespace(act=3)):
        with pytest.raises(InputError, match="a policy has act"):
            as_policy(given)


class Scene:
    """Stands in for `kinreach/Lift-v0`: a tool that is upright at the start, and postures that are counted."""

    def __init__(self):
        self.unwrapped, self.home, self.accept = self, np.zeros(6), "the test"
        self.kinematics = SimpleNamespace(fk=lambda q: np.diag([1.0, -1.0, -1.0, 1.0]))
        self.arm = SimpleNamespace(gripper=SimpleNamespace(sides=(0.05, 0.05)))

    def grasp_action(self, q, opening):
        return q, opening


@pytest.mark.parametrize(("cube", "turns"), [(False, 12), (True, 4)])
def test_a_scripted_grasp_tries_every_turn_of_the_fingers(cube, turns):
    asked = []

    class Refusing:
        def solve(self, goal, seed, *, accept):
            asked.append(goal.T)
            assert (accept, seed.tolist()) == ("the test", [0.0] * 6)
            return SimpleNamespace(iterations=2, success=len(asked) > turns, reason="no", q=np.ones(6))

    policy = GraspPolicy(Refusing(), Scene())
    observation = np.zeros(18)
    observation[SEEN], observation[SIZE], observation[IS_CUBE], observation[FACES] = (0.4, 0.4, -0.2), 0.02, cube, 0.3
    assert policy.act(observation) is None
    assert (policy.reason, policy.diagnostics) == ("no", {"iterations": 2 * turns, "poses": turns})
    np.testing.assert_allclose([T[:3, 3] for T in asked], [(0.4, 0.4, -0.2)] * turns)
    np.testing.assert_allclose([T[:3, 2] for T in asked], [(0.0, 0.0, -1.0)] * turns, atol=1e-12)
    angles = np.unwrap([np.arctan2(T[1, 0], T[0, 0]) for T in asked], period=2 * np.pi)
    steps = np.array([0, *(sign * k for k in range(1, turns) for sign in (-1, 1))])[:turns] * 2 * np.pi / turns
    np.testing.assert_allclose(np.cos(angles - angles[0] - steps), 1.0)
    faces = (angles - np.pi / 4 - 0.3) % (np.pi / 2)  # from the direction outwards
    assert np.allclose(np.minimum(faces, np.pi / 2 - faces), 0.0, atol=1e-9) == cube
    assert cube or angles[0] == pytest.approx(np.pi / 4)
    observation[SIZE], observation[SEEN] = 0.01, (0.4, 0.4, -0.195)
    q, opening = policy.act(observation)
    assert (q.tolist(), opening) == ([1.0] * 6, 0.0)  # fingers that press on 20 mm are closed
    assert (asked[-1][2, 3], policy.diagnostics["poses"]) == (pytest.approx(-0.193), 1)
    observation[SIZE] = 0.03
    assert policy.act(observation)[1] == pytest.approx(0.036)
    observation[SEEN] = 0.0
    assert policy.act(observation) is None
    assert policy.reason == "no camera found the object"

"""Imitation: the expert answers all states, who acts follows the share, and all answers are fitted."""

from contextlib import nullcontext
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.logger import configure

from kinreach._registration import BUTTON, PICK_AND_PLACE, PUSH
from kinreach.baselines import evaluate, get_recipe, train
from kinreach.baselines._algorithms import answered
from kinreach.baselines._imitation import MAX_SHARE, AnsweredVecEnv
from kinreach.baselines._models import build
from kinreach.baselines._rewards import own
from kinreach.baselines.inside import PickAndPlaceScript, PushScript
from kinreach.errors import InputError, TrainingError
from tests.baselines.small_runs import interrupted, weights

RECIPE = get_recipe("imitated-push")
SMALL = replace(
    RECIPE,
    num_envs=4,
    steps=80,
    segments=2,
    window=20,
    settings={**RECIPE.settings, "n_steps": 10, "batch_size": 40, "updates": 3},
)


class Counting:
    """Answers with a tenth of the row's first number, and keeps what it was asked."""

    def __init__(self):
        self.asked = []

    def act(self, rows):
        self.asked.append(np.array(rows))
        return np.add(np.tile(0.1 * rows[:, :1], (1, 6)), (0.0, 0.0, 0.0, 0.0, 0.0, 5.0))


class Batch(gym.vector.VectorEnv):
    """Keeps the actions; observations count."""

    def __init__(self, count):
        self.num_envs, self.acted = count, []
        self.metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
        self.single_observation_space = gym.spaces.Box(-9, 9, (3,))
        self.single_action_space = gym.spaces.Box(-1, 1, (6,))

    def seen(self):
        return np.random.default_rng(len(self.acted)).normal(size=(self.num_envs, 3)).astype(np.float32)

    def reset(self, *, seed=None, options=None):
        return self.seen(), {}

    def step(self, actions):
        self.acted.append(actions)
        no = np.zeros(self.num_envs, dtype=bool)
        return self.seen(), np.zeros(self.num_envs), no, no, {"is_success": no, "distance": np.zeros(self.num_envs)}


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_expert_answers_every_state_and_the_share_says_who_acts(share):
    batch, expert = Batch(20), Counting()
    env = AnsweredVecEnv(batch, expert=expert, reward=own)
    env.seed(1)
    env.reset()
    env.share = share
    for _ in range(200):
        env.step(np.full((20, 6), -0.5))
    acted = np.array(batch.acted)
    answers = np.clip([Counting().act(rows) for rows in expert.asked], -1.0, 1.0)
    learner = (acted == -0.5).all(axis=2)
    assert learner.shape == (200, 20)
    assert not learner[0].all()
    np.testing.assert_allclose(acted[~learner], answers[~learner], rtol=1e-6)
    np.testing.assert_allclose(learner[50:].mean(), share, atol=0.12)
    if 0.0 < share < 1.0:
        changes = (learner[1:] != learner[:-1]).mean()
        assert changes == pytest.approx(2.0 * share * (1.0 - share) / 15.0, rel=0.4)
    rows = env.answered()
    np.testing.assert_array_equal(rows[:, :3], np.concatenate(expert.asked))
    np.testing.assert_allclose(rows[:, 3:], answers.reshape(-1, 6), rtol=1e-6)
    env.step(np.zeros((20, 6)))
    assert len(env.answered()) == 20  # only those since


def test_answers_are_kept_until_newer_ones_take_their_place():
    """With room for 100 of the 120 answers of three rounds."""
    recipe = replace(SMALL, settings={**SMALL.settings, "memory": 100})
    trainee = build(recipe, 0, steps=120)
    model, rounds = trainee.model, []
    model.set_logger(configure(None, []))
    answered = trainee.env.answered
    trainee.env.answered = lambda: rounds.append(answered()) or rounds[-1]
    model.learn(120)
    trainee.env.close()
    assert [len(one) for one in rounds] == [40, 40, 40]
    kept, given = model.answered.numpy(), np.concatenate(rounds)
    np.testing.assert_allclose(kept[:20], given[100:], rtol=1e-6)
    np.testing.assert_allclose(kept[20:], given[20:100], rtol=1e-6)
    assert trainee.env.share == pytest.approx(MAX_SHARE)


def test_the_learning_rate_falls_to_zero_over_the_training():
    """From that of the recipe, linearly: by a third in each of three rounds."""
    trainee, rates = build(SMALL, 0, steps=120), []
    model, first = trainee.model, SMALL.settings["adaptive"]["first"]
    model.set_logger(configure(None, []))
    for _ in range(3):
        model.learn(40, reset_num_timesteps=False)
        rates += [group["lr"] for group in model.policy.optimizer.param_groups]
    trainee.env.close()
    assert SMALL.settings["adaptive"]["decay"] == 1.0
    np.testing.assert_allclose(rates, first * np.array([2 / 3, 1 / 3, 0.0]), atol=1e-12)


def test_the_expert_of_worlds_in_warp_is_made_of_one_in_mujoco():
    batch = gym.make_vec(PUSH, 3, vectorization_mode="vector_entry_point")
    answers = answered(batch, replace(RECIPE, options={"backend": "warp", "size": 0.03}), own)
    rows, script = answers.reset(), PushScript(gym.make(PUSH, size=0.03))
    actions = np.clip(script.act(rows), -1.0, 1.0)
    answers.step(np.zeros((3, 6)))
    np.testing.assert_allclose(answers.answered()[:, -6:], actions, atol=1e-6)


def test_threads_of_the_batch_are_none_of_the_experts_environment():
    trainee = build(replace(SMALL, options={"threads": 2}), 0, steps=80)
    trainee.env.reset()
    trainee.env.step(np.zeros((4, 6)))
    assert trainee.env.answered().shape == (4, trainee.model.answered.shape[1])
    trainee.env.close()


def test_the_actor_comes_to_answer_as_the_expert():
    """With the expert's turn alone, 60 rounds of four arms: the error falls to a third."""
    recipe = replace(SMALL, settings={**SMALL.settings, "updates": 20})
    trainee, errors = build(recipe, 0, steps=10**9), []  # no turns of the learner so early
    trainee.model.set_logger(configure(None, []))
    for _ in range(60):
        trainee.model.learn(40, reset_num_timesteps=False)
        errors.append(trainee.model.logger.name_to_value["train/loss"])
    trainee.env.close()
    assert np.mean(errors[-5:]) < np.mean(errors[:2]) / 3.0


def test_a_training_goes_on_with_the_answers_it_had(tmp_path):
    whole = train(SMALL, tmp_path / "whole", seed=4)
    interrupted(SMALL, tmp_path / "part", 1)
    state = torch.load(tmp_path / "part/checkpoint.pt", weights_only=True)
    assert int((state["variables"]["answered"] != 0.0).any(dim=1).sum()) == 40
    train(SMALL, tmp_path / "part", seed=4, resume=True)
    np.testing.assert_array_equal(
        weights(tmp_path / "part/policy.safetensors"), weights(whole.folder / "policy.safetensors")
    )


def test_an_expert_that_is_none():
    for settings, said in (({"expert": "kinreach.nothing:It"}, "expert"), ({}, "needs the setting 'expert'")):
        kept = {name: value for name, value in SMALL.settings.items() if name != "expert"}
        with pytest.raises(InputError, match=said):
            build(replace(SMALL, settings={**kept, **settings}), 0, steps=80)


class Bare:
    """An expert without an answer."""

    def __init__(self, env):
        pass


class Needless:
    """An expert that is made of nothing."""

    def act(self, rows):
        return np.zeros((len(rows), 6))


class Broken(Bare):
    def __init__(self, env):
        raise RuntimeError("no such file")


class Watching(Needless):
    """An expert that sees when its environment is closed."""

    closed: list[bool] = []  # noqa: RUF012 (of one test)

    def __init__(self, env):
        close = env.close
        env.close = lambda: self.closed.append(True) or close()


@pytest.mark.parametrize("updates", [3, 0])
def test_the_environment_of_the_expert_is_closed_once(updates, tmp_path, monkeypatch):
    """After the training, and where it is refused."""
    monkeypatch.setattr(Watching, "closed", [])
    settings = {**SMALL.settings, "expert": f"{__name__}:Watching", "updates": updates}
    with nullcontext() if updates else pytest.raises(InputError, match="updates"):
        train(replace(SMALL, settings=settings), tmp_path)
    assert Watching.closed == [True]


class Mute(Watching):
    act = None


def test_the_environment_of_an_expert_that_is_refused_is_closed(monkeypatch):
    monkeypatch.setattr(Watching, "closed", [])
    with pytest.raises(InputError, match="Mute has no method act"):
        build(replace(SMALL, settings={**SMALL.settings, "expert": f"{__name__}:Mute"}), 0, steps=80)
    assert Watching.closed == [True]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"expert": 5}, "an expert of your own is named module:attribute, got 5"),
        ({"expert": f"{__name__}:Bare"}, r"Bare has no method act\(rows\)"),
        ({"expert": f"{__name__}:Needless"}, "Needless cannot be made of an environment: TypeError"),
        ({"expert": f"{__name__}:Broken"}, r"RuntimeError: no such file \(test_imitation.py, line \d+\)"),
    ],
)
def test_an_expert_that_cannot_answer_is_named(changed, said):
    with pytest.raises(InputError, match=said):
        build(replace(SMALL, settings={**SMALL.settings, **changed}), 0, steps=80)


def test_numbered_actions_are_refused():
    recipe = replace(SMALL, environment=BUTTON, options={}, networks=replace(SMALL.networks, features="raw"))
    with pytest.raises(InputError, match=r"needs actions that are vectors, got Discrete\(54\)"):
        build(recipe, 0, steps=80)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (lambda rows: 1 / 0, r"the expert Answering failed: ZeroDivisionError.* \(test_imitation.py, line \d+\)"),
        (lambda rows: "left", "the expert Answering failed: ValueError"),
        (lambda rows: np.zeros(6), r"the expert Answering must have shape \(3, 6\), got \(6,\)"),
        (lambda rows: np.zeros((3, 2)), r"the expert Answering must have shape \(3, 6\), got \(3, 2\)"),
        (lambda rows: np.zeros((3, 1)), r"the expert Answering must have shape \(3, 6\), got \(3, 1\)"),
        (lambda rows: None, r"the expert Answering must have shape \(3, 6\), got \(\)"),
        (lambda rows: np.full((3, 6), np.nan), "an answer of the expert Answering became nan"),
        (lambda rows: np.full((3, 6), np.inf), "an answer of the expert Answering became inf"),
    ],
)
def test_answers_that_are_none_end_the_training(answer, said):
    class Answering:
        def act(self, rows):
            return answer(rows)

    env = AnsweredVecEnv(Batch(3), expert=Answering(), reward=own)
    env.reset()
    with pytest.raises(TrainingError, match=said):
        env.step(np.zeros((3, 6)))


@pytest.mark.parametrize(("name", "script"), [(PUSH, PushScript), (PICK_AND_PLACE, PickAndPlaceScript)])
def test_a_script_answers_rows_as_it_answers_each(name, script):
    """In states that its own way never passes, too."""
    policy, rng = script(gym.make(name)), np.random.default_rng(0)
    batch = gym.make_vec(name, 6, vectorization_mode="vector_entry_point")
    rows, compared = batch.reset(seed=3)[0], 0
    for _ in range(25):
        answers = policy.act(rows)
        assert (np.abs(answers) <= 1.0 + 1e-12).all()
        np.testing.assert_allclose(answers, [policy.act(row) for row in rows], atol=1e-9)
        rows, compared = batch.step(answers + rng.normal(0.0, 0.4, answers.shape))[0], compared + len(rows)
    assert compared == 150


@pytest.mark.slow
def test_a_short_training_brings_objects_to_their_places(tmp_path):
    """A third of the recipe's actions."""
    recipe = replace(get_recipe("imitated-pick-and-place"), steps=64_000)
    found = evaluate(train(recipe, tmp_path, seed=7).policy, goals=100)
    assert found.reached.mean() > 0.5

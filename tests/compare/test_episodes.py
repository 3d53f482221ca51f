"""Episodes of the button task in the comparison: what the environment says of them, seed by seed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from kinreach.baselines.button_controller import AnalyticButtonPolicy
from kinreach.baselines.evaluation import HELD_OUT
from kinreach.baselines.policies import load_policy
from kinreach.compare.button import players
from kinreach.compare.button.episodes import WARM_UP_SEED, play, run_episodes
from kinreach.compare.button.players import Player
from kinreach.compare.methods import METHODS, new_method
from kinreach.compare.tasks import ButtonTask
from kinreach.compare.tasks.button import EpisodeSettings
from kinreach.compare.trials import EpisodeTrial
from kinreach.errors import InputError

GOALS, SEED = 5, 3


@pytest.fixture(scope="module")
def task() -> ButtonTask:
    """Episodes of at most 60 steps."""
    return ButtonTask(EpisodeSettings(max_steps=60))


@pytest.fixture(scope="module")
def entrants(task: ButtonTask, button_policy: Path) -> dict[str, Player]:
    """Controller, policy and chance."""
    return {name: new_method(task, name) for name in ("analytic", str(button_policy), "random")}


@pytest.fixture(scope="module")
def trials(task: ButtonTask, entrants: dict[str, Player]) -> list[EpisodeTrial]:
    return list(run_episodes(task, entrants, GOALS, SEED))


def _untimed(trials: list[EpisodeTrial]) -> dict[tuple[int, str], EpisodeTrial]:
    return {(trial.goal, trial.method): replace(trial, solve_s=0.0) for trial in trials}


def test_the_methods_are_those_of_the_contract() -> None:
    assert list(METHODS["button"]) == ["analytic", "ppo", "random"]


def test_trials_are_the_episodes_of_the_environment(
    trials: list[EpisodeTrial], entrants: dict[str, Player], button_policy: Path
) -> None:
    """Played again through Gymnasium, with policies made here."""
    others: dict[str, Any] = {"analytic": AnalyticButtonPolicy("tuned"), str(button_policy): load_policy(button_policy)}
    checked = 0
    with gym.make("kinreach/ButtonPress-v0", max_steps=60) as env:
        for trial in trials:
            seed = HELD_OUT + SEED * 2**32 + trial.goal
            policy = others.get(trial.method) or entrants["random"].policy(seed)
            observation, info = env.reset(seed=seed)
            policy.reset(info)
            total, over = 0.0, False
            while not over:
                observation, reward, terminated, truncated, info = env.step(policy.act(observation))
                total, over = total + float(reward), terminated or truncated
            assert (trial.x, trial.y, trial.z) == tuple(info["goal"])
            assert trial.reward == total
            assert (trial.reached, trial.impossible) == (info["is_success"], info["impossible"])
            ours = (trial.distance, trial.steps, trial.wrong_presses, trial.energy)
            assert ours == tuple(info[name] for name in ("distance", "steps", "wrong_presses", "energy"))
            assert np.cos(trial.q) == pytest.approx(observation[:3], abs=1e-12)
            assert np.sin(trial.q) == pytest.approx(observation[3:6], abs=1e-12)
            assert trial.move_s == (pytest.approx(0.04 * trial.steps) if trial.reached else None)
            checked += 1
    assert checked == 3 * GOALS


def test_the_controller_presses_and_chance_does_not(trials: list[EpisodeTrial]) -> None:
    by_method = {name: [t for t in trials if t.method == name] for name in ("analytic", "random")}
    assert {(t.status, t.wrong_presses) for t in by_method["analytic"]} == {("pressed", 0)}
    assert max(t.distance for t in by_method["analytic"]) < 0.05
    assert {(t.status, t.steps, t.move_s, t.completed) for t in by_method["random"]} == {
        ("not pressed", 60, None, False)
    }
    assert min(t.wrong_presses for t in by_method["random"]) > 10


def test_all_methods_get_the_same_targets_and_goals_differ(trials: list[EpisodeTrial]) -> None:
    targets = [{(t.x, t.y, t.z) for t in trials if t.goal == goal} for goal in range(GOALS)]
    assert [len(found) for found in targets] == [1] * GOALS
    assert len(set.union(*targets)) == GOALS


def test_no_seed_is_one_that_training_draws_and_none_comes_twice(task: ButtonTask) -> None:
    seeds = [task.environment_seed(goal, seed) for seed in range(4) for goal in range(2000)]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) == HELD_OUT >= 2**31  # training draws below 2**31
    assert WARM_UP_SEED not in seeds


def test_an_episode_depends_on_nothing_but_its_goal_and_method(
    task: ButtonTask, trials: list[EpisodeTrial], entrants: dict[str, Player]
) -> None:
    whole = _untimed(trials)
    done = [trial for trial in trials if (trial.goal + len(trial.method)) % 3 == 0]
    left = _untimed(list(run_episodes(task, entrants, GOALS, SEED, done=done)))
    assert len(left) == 3 * GOALS - len(done)
    assert 0 < len(done) < 3 * GOALS
    assert left == {key: whole[key] for key in left}
    fewer = _untimed(list(run_episodes(task, {"random": entrants["random"]}, 2, SEED)))
    assert fewer == {(goal, "random"): whole[goal, "random"] for goal in range(2)}
    assert not set(_untimed(list(run_episodes(task, entrants, 1, SEED + 1))).values()) & set(whole.values())


def test_methods_take_turns(task: ButtonTask, entrants: dict[str, Player]) -> None:
    short = ButtonTask(EpisodeSettings(max_steps=1))
    order = [trial.method for trial in run_episodes(short, entrants, 30, 0)]
    turns = {tuple(order[first : first + 3]) for first in range(0, 90, 3)}
    assert {tuple(sorted(turn)) for turn in turns} == {tuple(sorted(entrants))}
    assert len(turns) == 6


class _Witness:
    """Does nothing, and keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[str] = []

    def reset(self, info: dict[str, Any]) -> None:
        self.told.append(f"reset {sorted(info)}")

    def act(self, observation: np.ndarray) -> int:
        self.told.append(f"act {observation.shape}")
        return 13


def test_a_policy_is_told_of_the_start_once_and_asked_before_every_step(task: ButtonTask) -> None:
    witness = _Witness()
    episode = play(task.new_environment(), witness, 7)
    assert witness.told == ["reset ['distance', 'goal']", *["act (19,)"] * 60]
    assert episode.info["steps"] == 60
    assert episode.solve_s > 0


def test_chance_draws_other_actions_for_every_goal(task: ButtonTask) -> None:
    player = players.chance(task)

    def drawn(seed: int) -> tuple[int, ...]:
        policy = player.policy(seed)
        return tuple(policy.act(None) for _ in range(200))

    assert drawn(5) == drawn(5)
    assert len({drawn(seed) for seed in range(20)}) == 20
    assert {action for seed in range(20) for action in drawn(seed)} == set(range(54))


def test_a_simulation_that_diverges_is_impossible(task: ButtonTask, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinreach.envs.button.episodes.SPEED_BOUND", 0.5)
    (trial,) = run_episodes(task, {"analytic": players.analytic(task)}, 1, 0)
    assert (trial.status, trial.reached, trial.impossible, trial.completed) == ("diverged", False, True, False)
    assert "faster than" in trial.reason
    assert trial.steps < 10
    assert trial.move_s is None


def test_the_reports_actuation_is_pressed_too() -> None:
    task = ButtonTask(EpisodeSettings(max_steps=1000, actuation="report"))
    found = list(run_episodes(task, {"analytic": players.analytic(task)}, 3, 0))
    assert [trial.status for trial in found] == ["pressed"] * 3
    assert all(trial.move_s == pytest.approx(0.004 * trial.steps) for trial in found)
    targets = [(t.x, t.y, t.z) for t in run_episodes(ButtonTask(), {"random": players.chance(task)}, 3, 0)]
    assert [(t.x, t.y, t.z) for t in found] == targets


def test_ppo_is_the_policy_of_the_package(
    task: ButtonTask, button_policy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Any, Any]] = []

    def load(policy: str, *, environment: str | None = None) -> Any:
        asked.append((policy, environment))
        return load_policy(button_policy)

    monkeypatch.setattr("kinreach.compare.button.players.load_policy", load)
    monkeypatch.setattr("kinreach.compare.button.players.policy_version", lambda policy: {f"policy {policy}": "abc"})
    player = new_method(task, "ppo")
    assert asked == [("button", "kinreach/ButtonPress-v0")]
    assert (player.kind, player.versions) == ("policy", {"policy button": "abc"})


def test_a_policy_for_another_task_is_refused(task: ButtonTask, clumsy: Path) -> None:
    with pytest.raises(InputError, match=r"is for kinreach/UR5SingleStep-v0, not for kinreach/ButtonPress-v0"):
        new_method(task, str(clumsy / "single.safetensors"))


Make = Callable[..., list[EpisodeTrial]]


def test_an_episode_survives_json(make_episodes: Make) -> None:
    for trial in make_episodes(2, move_s=None, reached=False):
        assert EpisodeTrial.from_dict(json.loads(trial.to_json())) == trial

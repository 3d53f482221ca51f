"""Trained policies in the comparison: what they are given, and that they are judged as in their environments."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from kinreach.baselines.policies import load_policy
from kinreach.checks import Floats
from kinreach.compare import Settings, Trial, compare
from kinreach.compare.methods import new_method
from kinreach.compare.observation import CameraSettings, looking
from kinreach.compare.policies import PolicyMethod
from kinreach.compare.runner import run_trials
from kinreach.compare.tasks import UR5Task
from kinreach.sim.simulation import ArmSimulation
from kinreach.vision.goal_view import geometric_goal_view


def _episode(policy: str, goal: Floats, **options: Any) -> tuple[float, dict[str, Any], int]:
    """Last reward, last info and number of steps of the policy's environment with this goal."""
    loaded = load_policy(policy)
    with gym.make(loaded.card.environment, **options) as env:
        observation, info = env.reset(seed=0, options={"goal": goal})
        loaded.reset(info)
        steps, over = 0, False
        while not over:
            observation, reward, terminated, truncated, info = env.step(loaded.act(observation))
            steps, over = steps + 1, terminated or truncated
    return float(reward), info, steps


def _rows(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "results.csv").read_text().splitlines()))


def _same(trial: Trial, reward: float, info: dict[str, Any], steps: int) -> bool:
    """Whether a trial ended exactly as the episode did."""
    ours = (trial.reward, trial.distance, trial.posture_error, trial.reached, trial.impossible, trial.iterations)
    return ours == (
        reward, info["distance"], info["posture_error"], info["reached"], info["impossible"], steps
    )  # fmt: skip


@pytest.mark.parametrize("policy", ["single", "multi", "thesis-single"])
def test_the_verdict_is_the_environments_to_the_last_bit(policy: str, task: UR5Task, simulation: ArmSimulation) -> None:
    goals = task.goals(6, 11)
    trials = list(run_trials(task, {policy: PolicyMethod(task.arm, policy)}, goals, simulation))
    assert [trial.goal for trial in trials] == list(range(6))
    for trial in trials:
        assert _same(trial, *_episode(policy, goals[trial.goal], backend="mujoco"))


@pytest.mark.parametrize("name", ["single", "multi"])
def test_so_is_that_of_policies_which_hit_things(
    name: str, clumsy: Path, task: UR5Task, simulation: ArmSimulation
) -> None:
    policy = str(clumsy / f"{name}.safetensors")
    goals = task.goals(5 if name == "single" else 2, 5)
    trials = list(run_trials(task, {name: new_method(task, policy)}, goals, simulation))
    for trial in trials:
        assert _same(trial, *_episode(policy, goals[trial.goal], backend="mujoco"))
    assert not all(trial.reached for trial in trials)
    if name == "single":
        assert sum(trial.impossible for trial in trials) > 0
    else:
        assert max(trial.iterations or 0 for trial in trials) == 100  # truncated, as the environment does


@pytest.mark.usefixtures("no_figures")
def test_with_cameras_too(needs_gl: None, tmp_path: Path) -> None:
    """Noise-free pictures are the same every time, so the environment's agent sees what ours saw."""
    camera = CameraSettings(width=320, height=180)
    names = ("ranked-single", "ranked-multi")
    compare(Settings(methods=names, goals=2, seed=3, observation="camera", camera=camera), tmp_path)
    rows = _rows(tmp_path)
    assert len(rows) == 4
    for row in rows:
        goal = np.array([float(row[axis]) for axis in "xyz"])
        policy = row["method"].removeprefix("ranked-")
        reward, info, steps = _episode(policy, goal, observation="camera", width=320, height=180)
        assert (float(row["reward"]), float(row["distance"]), int(row["iterations"])) == (
            reward, info["distance"], steps
        )  # fmt: skip
        view = np.array([float(value) for value in row["view"].split()])
        assert 0 < np.abs(view - geometric_goal_view("ur5", goal)).max() < 0.003


class _Witness:
    """Plays a policy of the package, and keeps what it is given."""

    def __init__(self, policy: str) -> None:
        self._policy = load_policy(policy)
        self.card = self._policy.card
        self.given: list[Floats] = []

    def act(self, observation: Floats) -> Any:
        """As the policy that it plays."""
        self.given.append(observation.copy())
        return self._policy.act(observation)


@pytest.mark.parametrize("name", ["single", "multi"])
def test_a_policy_is_given_the_cameras_views_as_they_are(
    name: str, task: UR5Task, simulation: ArmSimulation, stand_in: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    witness = _Witness(name)
    monkeypatch.setattr("kinreach.compare.policies.load_policy", lambda policy: witness)
    method, goals = PolicyMethod(task.arm, name), task.goals(2, 0)
    stand_in.found = (True, False)
    with looking(task, CameraSettings(), 0) as look:
        trials = list(run_trials(task, {name: method}, goals, simulation, look=look))
    assert gripper_of(witness) == {task.arm.gripper.opening}  # type: ignore[union-attr]
    for trial in trials:
        expected = geometric_goal_view("ur5", goals[trial.goal]) * (1, 1, 1, 0, 0, 0)
        given = [o for o in witness.given if np.array_equal(o[:6], expected)]
        assert len(given) == trial.iterations
        assert trial.view == tuple(expected)
        assert np.array_equal(given[0][6:12], task.home)
        assert name == "single" or len({tuple(o[6:12]) for o in given}) > 5  # where the arm has got to


def gripper_of(witness: _Witness) -> set[float]:
    """Every opening of the gripper that a witness was given."""
    assert witness.given
    assert {o.shape for o in witness.given} == {(13,)}
    return {float(o[12]) for o in witness.given}


@pytest.mark.usefixtures("no_figures")
def test_after_an_interruption_policies_are_given_the_same_views(stand_in: Any, tmp_path: Path) -> None:
    stand_in.sigma = 0.002
    settings = Settings(methods=("ranked-single", "ranked-multi", "hybrid"), goals=3, observation="camera")
    whole, resumed = outs = tmp_path / "whole", tmp_path / "resumed"
    compare(settings, whole)

    def interrupt(done: int, total: int) -> None:
        if done == 4:  # in the middle of the second goal
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(settings, resumed, progress=interrupt)
    compare(settings, resumed)
    times = ("solve_s", "accept_s", "look_s")
    whole_rows, resumed_rows = (
        [{k: v for k, v in row.items() if k not in times} for row in _rows(out)] for out in outs
    )
    assert len(whole_rows) == 9
    assert whole_rows == resumed_rows
    assert len({row["view"] for row in whole_rows}) == 3

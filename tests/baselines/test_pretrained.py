"""The policies of the package still do what is published of them; a sample here, the whole in the slow tests."""

import re
import subprocess
import sys

import numpy as np
import pytest

from kinreach.baselines.evaluation import evaluate
from kinreach.baselines.learned import load_policy, pretrained_names

#: Name -> least share reached, largest median [mm], least share within 1 mm and within 2 mm; not from cameras.
PUBLISHED = {
    "single": (0.995, 0.3, 0.99, 0.99),
    "multi": (0.995, 1.0, 0.0, 0.95),
    "ppo-single": (0.995, 3.0, 0.0, 0.0),
    "ppo-multi": (0.99, 10.0, 0.0, 0.0),
}


def check(name, least_reached=None, **settings):
    reached, median, within_1, within_2 = PUBLISHED[name]
    summary = evaluate(load_policy(name), **settings).summary()
    assert summary["goals"] == settings["goals"]
    assert summary["reached"] >= (reached if least_reached is None else least_reached)
    assert summary["distance_mm"]["median"] <= median
    assert summary["success_at_mm"]["1"] >= within_1
    assert summary["success_at_mm"]["2"] >= within_2


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_sample_of_held_out_goals(name):
    check(name, goals=400, options={"backend": "kinematic"})


def test_a_sample_in_dynamics():
    for name in ("single", "multi"):
        check(name, 0.99, goals=100, options={"backend": "mujoco"})


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_all_held_out_goals(name):
    check(name, goals=10_000, options={"backend": "kinematic"})
    check(name, 0.99, goals=500, options={"backend": "mujoco"})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["single", "multi"])
def test_goals_seen_by_cameras(name, needs_gl):
    policy = load_policy(name)
    found = evaluate(policy, goals=100, options={"backend": "mujoco", "observation": "camera"})
    assert found.reached.mean() >= 0.97
    assert np.median(found.measures["distance"]) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", pretrained_names())
def test_what_a_card_says_was_measured_can_be_measured_again(name):
    policy = load_policy(name)
    again = {command: said for command, said in policy.card.results.items() if "camera" not in command}
    assert again
    for command, said in again.items():
        options = dict(re.findall(r"--(backend) (\w+)", command)) or policy.card.recipe["options"]
        found = evaluate(policy, goals=said["goals"], options=options).summary()
        assert f"--goals {said['goals']}" in command
        assert found["reached"] == pytest.approx(said["reached"], abs=2e-3)
        assert found["distance_mm"]["median"] == pytest.approx(said["distance_mm"]["median"], rel=0.02)


def test_policies_run_without_the_libraries_that_trained_them():
    code = (
        "import sys; from kinreach.baselines.evaluate_cli import main; "
        "main(['single', '--goals', '5', '--backend', 'kinematic'], prog='evaluate'); "
        "found = {'torch', 'stable_baselines3', 'tensorboard'} & set(sys.modules); "
        "print(found); sys.exit(len(found))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "held-out goals" in done.stdout

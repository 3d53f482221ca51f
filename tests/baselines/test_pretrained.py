"""The policies of the package do what is published of them: what their cards say was measured is measured again.

What takes a second is in every run, the rest in the slow tests.
"""

import json
import shlex
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import benchmarks.learners  # noqa: F401 (registers its recipes)
from benchmarks.logs import log_names, logged_policies
from kinreach._registration import BUTTON, MOVING, PICK_AND_PLACE, PUSH, RANDOM_ARM
from kinreach._statistics import wilson_interval
from kinreach.baselines import HELD_OUT, evaluate, get_recipe, load_policy
from kinreach.baselines.inside import pretrained_names
from kinreach.cli import main
from kinreach.errors import InputError
from tests.policy_files import copy_policy

CARDS = {name: load_policy(name).card for name in pretrained_names()}
#: Those that the documentation's tables are about.
PUBLISHED = (
    "ranked-single",
    "ranked-multi",
    "ppo-single",
    "ppo-multi",
    "thesis-ppo-single",
    "thesis-ppo-multi",
    "button",
    "button-report",
)
#: What single-step policies do without dynamics takes a second; episodes, dynamics and cameras take longer.
QUICK = ("ranked-single", "ppo-single", "random-arms")
#: Of what takes longer so many goals are measured again.
SAMPLE = 50
#: How far apart actions for an observation and its rounding to single precision may be, in units of the action.
ROUNDED = 1e-4
#: Shares of goals: on another processor one or two goals may fall on the other side of a limit.
SHARES = ("reached", "impossible", "success_at_mm")


def quick(name, command):
    return name in QUICK and "--backend mujoco" not in command


def measured(*, seen):
    """Policy and command of everything that the cards say, with goals that are seen in pictures or are known."""
    for name, card in CARDS.items():
        for command in card.results:
            if seen != ("camera" in command or bool(load_policy(name).network.eyes)):
                continue
            kind = command.split(" --", 1)[1].replace("--", "")
            marks = [] if quick(name, command) else pytest.mark.slow
            yield pytest.param(name, command, id=f"{name}, {kind}", marks=marks)


def flat(value, path=()):
    """Numbers by their place in nested objects and lists."""
    if isinstance(value, int | float):
        return {path: value}
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return {place: number for key, part in items for place, number in flat(part, (*path, key)).items()}


@pytest.mark.parametrize(("name", "command"), list(measured(seen=False)))
@pytest.mark.slow
def test_what_a_card_says_was_measured_is_measured_again(name, command, tmp_path):
    measure_again(name, command, tmp_path)


@pytest.mark.parametrize(("name", "command"), list(measured(seen=True)))
def test_what_a_card_says_was_measured_in_pictures_is_measured_again(name, command, tmp_path, needs_gl):
    measure_again(name, command, tmp_path)


def measure_again(name, command, tmp_path):
    """Every figure where that is quick: on the same machine they are the same to the last digit. Else a sample."""
    words = shlex.split(command)
    assert words[:3] == ["python", "-m", "kinreach.evaluate"]
    policies = [word for word in words[3:] if word.endswith(".safetensors")]
    assert f"kinreach/baselines/pretrained/{name}.safetensors" in policies
    options, place = words[3 + len(policies) :], words.index("--goals") + 1
    goals = int(words[place])
    sample = goals if quick(name, command) else SAMPLE
    options[options.index("--goals") + 1] = str(sample)
    out = tmp_path / "found.json"
    assert main(["evaluate", name, *options, "--out", str(out)]) == 0
    said, found = CARDS[name].results[command], json.loads(out.read_text())["policies"][name]
    assert (said["goals"], found["goals"]) == (goals, sample)
    said, found = flat(said), flat(found)
    assert set(said) <= set(found)
    assert len(said) >= 31
    for place, value in said.items():
        if sample == goals:
            slack = {"abs": 2 / goals, "rel": 0} if place[0].startswith(SHARES) else {"rel": 1e-3}
            assert found[place] == pytest.approx(value, **slack), place
        elif place[0] in SHARES:
            low, high = wilson_interval(round(found[place] * sample), sample, confidence=0.9999)
            assert low <= value <= high, place
        elif place == ("distance_mm", "median"):
            assert found[place] == pytest.approx(value, rel=0.5)


def test_every_policy_says_what_it_does():
    """On the backends that it is published for, and the ranked ones, which see well enough, with cameras."""
    said = {name: [command.split(" --", 1)[1] for command in card.results] for name, card in CARDS.items()}
    for name in PUBLISHED:
        commands, button = said[name], name.startswith("button")
        wanted = ["goals 1000"] if button else ["goals 2000 --backend kinematic", "goals 500 --backend mujoco"]
        cameras = (
            ["goals 200 --backend mujoco --observation camera"] if name in ("ranked-single", "ranked-multi") else []
        )
        assert sorted(commands) == sorted(wanted + cameras)


@pytest.mark.slow
def test_the_ranked_policies_reach_in_dynamics_too():
    """A sample: the whole is measured again in the slow tests."""
    for name in ("ranked-single", "ranked-multi"):
        found = evaluate(load_policy(name), goals=100, options={"backend": "mujoco"})
        assert found.reached.mean() >= 0.99
        assert 1e3 * np.median(found.measures["distance"]) <= 0.3


def test_cards_are_those_of_the_recipes_as_they_are():
    """Also of the policies among the logs. Training again with what a card says gives its policy again."""
    cards = dict(CARDS)
    for recipe in log_names():
        try:
            found = logged_policies(recipe)
        except InputError:
            continue
        for seed, policy in found.items():
            assert (policy.card.recipe["name"], policy.card.seed) == (recipe, seed)
            cards[f"{recipe}/{seed}"] = policy.card
    assert len(cards) >= 12
    for name, card in cards.items():
        recipe = get_recipe(card.recipe["name"])
        now = json.loads(json.dumps(recipe.to_dict()))
        assert card.recipe | {"summary": ""} == now | {"summary": ""}, name  # its words may change
        meaning = "preferences" if recipe.environment == BUTTON else "posture" if recipe.networks.posture else "action"
        assert (card.environment, card.meaning, card.algorithm) == (recipe.environment, meaning, recipe.algorithm)
        assert recipe.steps <= card.steps < 1.02 * recipe.steps
        assert len(set(card.goal_seeds["training"])) == recipe.segments
        assert max(card.goal_seeds["training"]) < 2**31 < card.goal_seeds["held_out"] == HELD_OUT


@pytest.mark.slow
def test_policies_run_without_the_libraries_that_trained_them():
    code = (
        "import sys; from kinreach.cli import main; "
        "main(['evaluate', 'ranked-single', '--goals', '5', '--backend', 'kinematic']); "
        "found = {'torch', 'stable_baselines3', 'tensorboard'} & set(sys.modules); "
        "print(found); sys.exit(len(found))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "held-out goals" in done.stdout


@pytest.mark.parametrize("name", sorted(CARDS))
def test_policies_act_alike_in_single_precision(name):
    """As everybody's environments observe, who does not ask for doubles."""
    policy = load_policy(name)
    if policy.network.eyes:
        pytest.skip("sees pictures")
    plain = (
        {}
        if policy.card.environment in (BUTTON, MOVING, RANDOM_ARM, PUSH, PICK_AND_PLACE) or name == "ppo-lift-multi"
        else {"backend": "kinematic"}
    )
    given = {**plain, **policy.needed_options, "dtype": "float64"}
    batch = gym.make_vec(policy.card.environment, 32, "vector_entry_point", **given)
    seen, _ = batch.reset(seed=0)
    compared = 0
    for _ in range(2):
        doubles, singles = policy.act(seen), policy.act(seen.astype(np.float32))
        if policy.card.meaning == "preferences":
            assert (doubles == singles).mean() >= 0.95  # two preferences may be as good as the same
        else:
            np.testing.assert_allclose(singles, doubles, rtol=0, atol=ROUNDED)
        compared += len(doubles)
        seen = batch.step(doubles)[0]
    batch.close()
    assert compared == 2 * 32


def test_results_are_recorded_in_each_file_under_the_command_that_makes_them(tmp_path, capsys):
    files = [str(tmp_path / f"{name}.safetensors") for name in ("one", "two")]
    for file, name in zip(files, ("ranked-single", "ppo-single"), strict=True):
        copy_policy(name, file, results={"earlier": {"reached": 0.5}})
    assert main(["evaluate", *files, "--goals", "3", "--backend", "kinematic", "--record"]) == 0
    out, recorded = " ".join(capsys.readouterr().out.split()), []
    for file in files:
        found = dict(load_policy(file).card.results)
        assert found.pop("earlier") == {"reached": 0.5}
        ((command, summary),) = found.items()
        assert command == f"kinreach evaluate {' '.join(files)} --goals 3 --backend kinematic"
        assert summary["goals"] == 3
        recorded.append(summary)
    assert "Again: kinreach evaluate" in out
    assert recorded[0] != recorded[1]

"""The tables of trained policies: which trainings count, what a row says, and that nothing is needed to say it."""

import json
import shutil
import sys
from importlib import resources

import gymnasium as gym
import numpy as np
import pytest

from benchmarks.studies import button_actuation, button_failures, button_policies, button_waiting, loitering, trained
from benchmarks.studies.trainings import ONE_SEED, Trainings, finished, trainings_interval, with_interval
from kinreach.baselines._evaluation import Evaluation
from kinreach.cli import finish
from kinreach.envs.inside import ACTUATIONS
from kinreach.errors import InputError

PRETRAINED = resources.files("kinreach.baselines") / "pretrained"


class Still:
    """A policy that asks for no motion."""

    def reset(self, observation, info):
        pass

    def act(self, observations):
        return np.zeros((len(observations), 6))


@pytest.fixture
def runs(tmp_path):
    """Two trainings of `ppo-multi-ending`, `ranked-single` and `button-report` each; one stands for the other."""
    for recipe, policy in (
        ("ppo-multi-ending", "ppo-multi"),
        ("ranked-single", "ranked-single"),
        ("button-report", "button-report"),
    ):
        for seed in (2, 10):
            folder = tmp_path / recipe / f"seed-{seed}"
            folder.mkdir(parents=True)
            shutil.copy(PRETRAINED / f"{policy}.safetensors", folder / "policy.safetensors")
            (folder / "run.json").write_text(json.dumps({"cpu_seconds": 40.4 + seed}))
    return tmp_path


def table(text):
    head, rule, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    assert len(rule) == len(head)
    assert all(len(row) == len(head) for row in rows)
    return head, rows


def test_only_finished_trainings_count_in_the_order_of_their_seeds(runs):
    def seeds():
        return {
            name: [path.name for path in found]
            for name, found in finished(runs, ("ranked-single", "sac-single")).items()
        }

    assert seeds() == {"ranked-single": ["seed-2", "seed-10"]}
    (runs / "ranked-single" / "seed-2" / "run.json").unlink()
    assert seeds() == {"ranked-single": ["seed-10"]}
    (runs / "ranked-single" / "seed-10" / "policy.safetensors").unlink()
    with pytest.raises(InputError, match=r"^no finished training of ranked-single, sac-single in "):
        seeds()


def test_where_nothing_is_trained_the_command_says_so(run_python, tmp_path, monkeypatch, capsys):
    """As a program of its own, and by the entry of each."""

    def says_so(study, code, out, err):
        assert (code, out) == (2, "")
        assert err.startswith(f"python -m benchmarks.studies.{study}: error: no finished training of ")
        assert err.count("\n") == 1

    done = run_python("-m", "benchmarks.studies.trained", "results/train")
    says_so("trained", done.returncode, done.stdout, done.stderr)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["study", "results/train"])
    for study in (button_policies, button_waiting, loitering):
        says_so(study.__name__.rpartition(".")[2], finish(study.main, prog=study.PROG), *capsys.readouterr())


def test_the_table_of_reach_policies(runs, capsys):
    assert trained.main([str(runs), "--recipes", "ranked-single,sac-single", "--goals", "40"]) == 0
    head, rows = table(capsys.readouterr().out)
    assert [row[:2] for row in rows] == [["`ranked-single`", "2"]]
    said = dict(zip(head, rows[0], strict=True))
    assert said["reached, % [95 % CI over seeds]"] == "100.00 [91.24, 100.00]"  # Wilson's, 40 of 40, not 80 of 80
    assert said["training, s of processor"] == "42–50"
    assert said["worst seed: median, mm"] == said["median, mm [95 % CI over seeds]"].split(" ")[0]


def test_the_table_of_button_policies_and_its_note(runs, capsys):
    shutil.rmtree(runs / "button-report" / "seed-2")
    assert button_policies.main([str(runs), "--goals", "20"]) == 0
    text = capsys.readouterr().out
    assert text.endswith(f"\n\n{ONE_SEED}\n")
    _, rows = table(text.removesuffix(f"\n\n{ONE_SEED}\n"))
    assert [row[:2] for row in rows] == [["`button-report`", "1"]]


def test_in_the_reports_world_waiting_at_the_target_earns_more_than_pressing(runs, capsys):
    assert button_waiting.main([str(runs), "--recipes", "button-report", "--goals", "8"]) == 0
    _, (presses, waits, chance, trained_row) = table(capsys.readouterr().out)
    assert presses[2].startswith("100.0 [")
    assert waits[2].startswith("0.0 [")
    assert (presses[4], waits[4]) == ("100.0", "100.0")
    assert float(waits[-1]) > 1000.0 > float(presses[-1])
    assert float(chance[5]) > 100.0  # wrong presses in 1000 steps
    assert trained_row[:2] == ["`button-report`", "2"]


def test_a_row_has_the_interval_over_the_seeds():
    rng = np.random.default_rng(0)
    reached = rng.random((3, 50)) < np.array([[0.2], [0.5], [0.0]])
    steps = np.where(reached, np.array([[20.0], [30.0], [0.0]]), 100.0)
    wrong = rng.poisson(2.0, (3, 50)).astype(float)
    found = [
        Evaluation(
            [{"reached": hit, "steps": step, "wrong_presses": count} for hit, step, count in zip(*rows, strict=True)]
        )
        for rows in zip(reached, steps.tolist(), wrong.tolist(), strict=True)
    ]
    pressed, every, needed, presses, _ = button_policies.cells(Trainings("button", found, [1.0, 2.0, 3.0]))
    low, high = trainings_interval(reached)
    assert pressed == f"{100 * reached.mean():.1f} [{100 * low:.1f}, {100 * high:.1f}]"
    assert every.count(", ") == 2
    assert needed == "20, 30, -"
    assert presses.startswith(f"{wrong.mean():.2f} [")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (0.1906, "0.191"), (8.904, "8.90"), (60.06, "60.1"), (568.6, "569"), (1190.4, "1190")],
)
def test_three_digits(value, text):
    values = np.full((2, 5), value)
    assert with_interval(values) == f"{text} [{text}, {text}]"


def test_nobody_waits_beside_a_goal_that_is_never_near():
    assert loitering.watch(Still(), goals=3) == (0.0, 0.0, 0.0, None)


def test_loitering(runs, capsys, monkeypatch):
    monkeypatch.setattr(loitering, "watch", lambda policy: (50.0, 60.0, 0.0, None))
    assert loitering.main([str(runs)]) == 0
    _, rows = table(capsys.readouterr().out)
    assert rows == [[f"`ppo-multi-ending`, {seed}", "50.0", "60.0", "0.0", "-"] for seed in (2, 10)]


def test_where_button_policies_end(capsys):
    assert button_failures.main(["button-report", "--goals", "40"]) == 0
    _, ((name, shares, *missed),) = table(capsys.readouterr().out)
    assert name.startswith("`button-report`, seed")
    assert [float(share) for share in shares.split(" / ")] == [100.0] * 4
    assert missed == ["-", "-"]


def test_environments_are_closed(closings):
    made, batches = closings(gym, "make"), closings(gym, "make_vec")
    tuned = ACTUATIONS["tuned"]
    button_actuation.one_increment(tuned)
    button_actuation.random_actions(tuned, 2, 0)
    button_actuation.analytic(tuned, 2, 0)
    loitering.watch(Still(), goals=2)
    button_failures.main(["button-report", "--goals", "2"])
    assert [close.call_count for close in made + batches] == [1] * 5

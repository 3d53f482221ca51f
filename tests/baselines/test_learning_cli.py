"""`kinreach train` and `kinreach evaluate`: what they print, write and refuse."""

import json

import pytest

from kinreach.baselines import train_cli
from kinreach.cli import main


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    assert main(["train", "single", "--steps", "4096", "--seeds", "2", "--out", str(out)]) == 0
    return out


def test_training_prints_a_table_and_evaluation_reads_the_runs(trained, capsys, tmp_path):
    policies = [str(trained / f"single/seed-{seed}/policy.safetensors") for seed in (0, 1)]
    written = tmp_path / "new" / "evaluation.json"
    arguments = ["evaluate", *policies, "--goals", "20", "--backend", "kinematic", "--out", str(written), "--record"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "single/seed-1" in printed
    found = json.loads(written.read_text())
    assert found["command"] == f"kinreach evaluate {' '.join(policies)} --goals 20 --backend kinematic"
    assert {summary["goals"] for summary in found["policies"].values()} == {20}
    assert main(["evaluate", policies[0], "--goals", "3", "--backend", "kinematic"]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "nothing"], "unknown recipe 'nothing'; available: "),
        (["train", "single", "--steps", "0"], "--steps must be at least 1, got 0"),
        (["train", "single", "--seed", "-1"], "--seed must not be negative, got -1"),
        (["train", "single", "--steps", "many"], "invalid int value: 'many'"),
        (["train", "single", "--out", "/proc/nowhere"], "cannot write /proc/nowhere"),
        (["evaluate", "nothing"], "there is no policy 'nothing'"),
        (["evaluate", "nothing.safetensors"], "cannot read the policy nothing.safetensors: No such file"),
        (["evaluate", "single", "--goals", "0"], "--goals must be at least 1"),
        (["evaluate", "single", "--backend", "magic"], "unknown backend 'magic'; available: kinematic, mujoco"),
        (["evaluate", "single", "--max-steps", "3"], "--max-steps is for policies of the button task"),
        (["evaluate", "single", "--goals", "1", "--record"], "--record needs the path of a policy file"),
    ],
)
def test_bad_input_is_one_line(arguments, message, capsys):
    try:
        code = main(arguments)
    except SystemExit as leaving:
        code = leaving.code
    errors = capsys.readouterr().err
    assert code == 2
    assert message in errors
    assert errors.count("\n") == 1


def test_an_interruption_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    def stop(row):
        raise KeyboardInterrupt

    monkeypatch.setattr(train_cli, "_figures", stop)
    assert main(["train", "ppo-single", "--steps", "40000", "--seed", "7", "--out", str(tmp_path)]) == 130
    message = capsys.readouterr().err
    assert f"kinreach train ppo-single --seed 7 --steps 40000 --out {tmp_path} --resume" in message


def test_without_the_extra_training_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "kinreach.baselines.training", None)
    assert main(["train", "single"]) == 2
    assert "pip install 'kinreach[train]'" in capsys.readouterr().err


def test_help_lists_the_recipes(capsys):
    with pytest.raises(SystemExit) as leaving:
        main(["train", "--help"])
    assert leaving.value.code == 0
    assert "thesis-single" in capsys.readouterr().out

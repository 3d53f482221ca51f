"""`kinreach train` and `kinreach evaluate`: what they print, write and refuse."""

import io
import json
import re
import shlex
import shutil
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.progress import Progress

from kinreach import _provenance as provenance
from kinreach import plots
from kinreach._terminal import Console
from kinreach.baselines import HELD_OUT, VALIDATION, evaluate, load_policy
from kinreach.baselines import _evaluate_cli as evaluate_cli
from kinreach.baselines import _train_cli as train_cli
from kinreach.cli import main
from kinreach.errors import InputError
from tests.baselines.small_runs import interrupted, small
from tests.policy_files import copy_policy

SHIPPED = Path(str(resources.files("kinreach.baselines"))) / "pretrained"


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    assert main(["train", "ranked-single", "--steps", "4096", "--seeds", "2", "--out", str(out)]) == 0
    return out


@pytest.mark.slow
def test_training_prints_a_table_and_evaluation_reads_the_runs(trained, capsys, tmp_path):
    policies = [str(trained / f"ranked-single/seed-{seed}/policy.safetensors") for seed in (0, 1)]
    written = tmp_path / "new" / "evaluation.json"
    arguments = ["evaluate", *policies, "--goals", "20", "--backend", "kinematic", "--out", str(written), "--record"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "ranked-single/seed-1" in printed
    found = json.loads(written.read_text())
    assert found["command"] == f"kinreach evaluate {' '.join(policies)} --goals 20 --backend kinematic"
    assert {summary["goals"] for summary in found["policies"].values()} == {20}
    assert written.read_text() == json.dumps(found, indent=2) + "\n"
    for name, policy in zip(("ranked-single/seed-0", "ranked-single/seed-1"), policies, strict=True):
        assert load_policy(policy).card.results == {found["command"]: found["policies"][name]}
    assert main(["evaluate", policies[0], "--goals", "3", "--backend", "kinematic"]) == 0


def test_an_evaluation_is_written_as_it_is_printed(capsys, tmp_path, monkeypatch):
    """JSON of two spaces, with the command that gives the same numbers again, split and options included."""
    written = tmp_path / "new" / "found.json"
    options = ["--goals", "3", "--split", "validation", "--backend", "kinematic"]
    for names in (["ranked-single"], ["ranked-single", "ppo-single"]):
        assert main(["evaluate", *names, *options, "--out", str(written)]) == 0
        printed, text = capsys.readouterr().out, written.read_text()
        found = json.loads(text)
        assert text == json.dumps(found, indent=2) + "\n"
        assert list(found) == ["policies", "split", "command", "versions"]
        assert found["command"] == f"kinreach evaluate {' '.join([*names, *options])}"
        assert f"Again: {found['command']}" in printed
        assert f"Results: {written}" in printed
        assert (found["split"], list(found["policies"])) == ("validation", names)
        assert main([*shlex.split(found["command"])[1:], "--out", str(tmp_path / "again.json")]) == 0
        again = json.loads((tmp_path / "again.json").read_text())
        for name in names:
            assert again["policies"][name]["goals"] == 3
            assert again["policies"][name]["distance_mm"] == found["policies"][name]["distance_mm"]
        capsys.readouterr()


def test_finished_trainings_are_drawn_without_training_again(trained, capsys, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(plots, "draw_training", lambda curves, **words: drawn.append((curves, words)) or Figure())
    monkeypatch.setattr(train_cli, "GOALS", 2)
    picture = tmp_path / "mine.png"
    arguments = ["train", "ranked-single", "--steps", "4096", "--seeds", "2", "--out", str(trained), "--resume"]
    assert main([*arguments, "--picture", str(picture)]) == 0
    assert f"picture: {picture}" in capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")
    ((curves, words),) = drawn
    assert list(curves) == ["seed 0", "seed 1"]
    for seed, curve in enumerate(curves.values()):
        assert (trained / f"ranked-single/seed-{seed}/curve.csv").read_text().count("\n") == len(curve["steps"]) + 1
    assert words == {"environment": "kinreach/UR5SingleStep-v0", "title": "ranked-single, 2 seeds"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "nothing"], "unknown recipe 'nothing'; available: "),
        (["train", "ranked-single", "--steps", "0"], "--steps must be at least 1, got 0"),
        (["train", "ranked-single", "--seed", "-1"], "--seed must not be negative, got -1"),
        (["train", "ranked-single", "--steps", "many"], "invalid int value: 'many'"),
        (["train", "ranked-single", "--out", "/proc/nowhere"], "cannot write /proc/nowhere"),
        (["evaluate", "nothing"], "there is no policy 'nothing'"),
        (["evaluate", "nothing.safetensors"], "cannot read the policy nothing.safetensors: No such file"),
        (["evaluate", "ranked-single", "--goals", "0"], "--goals must be at least 1"),
        (["evaluate", "ranked-single", "--backend", "magic"], "unknown backend 'magic'; available: kinematic, mujoco"),
        (["evaluate", "ranked-single", "--max-episode-steps", "many"], "invalid int value: 'many'"),
        (["evaluate", "ranked-single", "--max-episode-steps", "0"], "max_episode_steps must be at least 1, got 0"),
        (["evaluate", "ranked-single", "--collisions", "true"], "--collisions is for policies of the moving ball"),
        (["evaluate", "button", "--backend", "kinematic"], "--backend, --observation and --exposure are for reach"),
        (["evaluate", "gradient-moving", "--collisions", "no"], "unknown --collisions 'no'; available: false, true"),
        (
            ["evaluate", "ranked-single", "--split", "training"],
            "unknown split 'training'; available: held-out, validation",
        ),
        (["evaluate", "ranked-single", "--out", ""], "--out must be a file, got ''"),
        (["evaluate", "ranked-single", "--out", "/proc/nowhere/x.json"], "cannot write /proc/nowhere"),
        (["evaluate", "x.safetensors", "ranked-single", "--record"], "--record needs the path of a policy file"),
        (
            ["evaluate", "x.safetensors", "--record", "--split", "validation"],
            "--record is for what was measured on held-out",
        ),
        (["evaluate", "ranked-single", "--env", "chess"], "unknown environment 'chess'; available: "),
        (["train", "ranked-single", "--split", "test"], "unknown split 'test'; available: held-out, validation"),
        (["train", "ranked-single", "--resume", "--fresh"], "--resume goes on with a run, --fresh replaces it"),
        (
            ["train", "ranked-single", "--picture", "no/folder/x.png"],
            "--picture must be a file in a folder that exists",
        ),
        (["train", "ranked-single", "--out", ""], "--out must name a folder, got ''"),
        (
            ["train", "ranked-single", "--seed", "2147483647", "--seeds", "2"],
            "--seed plus --seeds must be at most 2147483648, got 2147483649",
        ),
    ],
)
def test_bad_input_is_one_line_before_any_episode(arguments, message, capsys, monkeypatch, tmp_path):
    if arguments[-1] != "magic":  # which is for the environment to refuse
        monkeypatch.setattr(evaluate_cli, "evaluate", lambda *a, **k: pytest.fail("it plays episodes"))
    if "x.safetensors" in arguments:
        monkeypatch.chdir(tmp_path)
        shutil.copy(SHIPPED / "ranked-multi.safetensors", "x.safetensors")
    try:
        code = main(arguments)
    except SystemExit as leaving:
        code = leaving.code
    errors = capsys.readouterr().err
    assert code == 2
    assert message in errors
    assert errors.count("\n") == 1


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ([], ""),
        (
            ["--seeds", "2", "--threads", "3", "--split", "held-out", "--export"],
            "--seeds 2 --threads 3 --split held-out --export",
        ),
    ],
)
@pytest.mark.slow
def test_an_interruption_says_how_to_go_on(more, said, tmp_path, monkeypatch, capsys):
    def stop(row):
        raise KeyboardInterrupt

    out = tmp_path / "two words"
    monkeypatch.setattr(train_cli, "_figures", stop)
    given = ["ppo-single", "--steps", "40000", "--seed", "7", *more, "--out", str(out)]
    assert main(["train", *given]) == 130
    message = capsys.readouterr().err
    again = message.split("go on with: kinreach train ")[1].strip()
    assert sorted(shlex.split(again)) == sorted([*given, "--resume"])
    assert said in again.replace("--steps 40000 ", "")


def test_training_is_judged_by_validation_goals_and_evaluation_by_held_out_ones(trained, capsys, monkeypatch, tmp_path):
    """A recipe that is changed because of what `train` prints has not seen the goals that results are measured on."""
    seeds = []

    def note(*arguments, seed, **settings):
        seeds.append(seed)
        return evaluate(*arguments, seed=seed, **{**settings, "goals": 2})

    monkeypatch.setattr(train_cli, "evaluate", note)
    monkeypatch.setattr(evaluate_cli, "evaluate", note)
    train = ["train", "ranked-single", "--steps", "4096", "--out", str(trained), "--resume"]
    assert main(train) == 0
    assert "ranked-single, 1000 validation goals" in capsys.readouterr().out
    assert main([*train, "--split", "held-out"]) == 0
    assert "ranked-single, 1000 held-out goals" in capsys.readouterr().out
    policy, out = str(trained / "ranked-single/seed-0/policy.safetensors"), tmp_path / "found.json"
    play = ["evaluate", policy, "--goals", "2", "--backend", "kinematic", "--out", str(out)]
    assert main(play) == 0
    assert "2 held-out goals" in capsys.readouterr().out
    assert json.loads(out.read_text())["split"] == "held-out"
    assert main([*play, "--split", "validation"]) == 0
    assert "2 validation goals" in capsys.readouterr().out
    found = json.loads(out.read_text())
    assert found["split"] == "validation"
    assert found["command"] == f"kinreach evaluate {policy} --goals 2 --split validation --backend kinematic"
    assert seeds == [VALIDATION, HELD_OUT, HELD_OUT, VALIDATION]


def test_a_policy_of_the_button_task_is_evaluated_as_it_was_trained(monkeypatch, tmp_path):
    """Episode length and actuation are those of its card, unless the command line says otherwise."""
    played = []

    def note(policy, *, options, **settings):
        played.append(options)
        return evaluate(policy, options={**options, "max_episode_steps": 2}, **settings)

    monkeypatch.setattr(evaluate_cli, "evaluate", note)
    recipe = load_policy("button").card.recipe
    for options in (
        {"max_episode_steps": 100},
        {"actuation": "report", "max_episode_steps": 500, "end_on_reached": False},
        {},
        None,
    ):
        file = tmp_path / f"{len(played)}.safetensors"
        copy_policy("button", file, recipe={**recipe, "options": options})
        assert main(["evaluate", str(file), "--goals", "1"]) == 0
        assert main(["evaluate", str(file), "--goals", "1", "--max-episode-steps", "7"]) == 0
    tuned, report = {"max_episode_steps": 100}, {"actuation": "report", "max_episode_steps": 500}
    seven = {"max_episode_steps": 7}
    assert played == [tuned, seven, report, {**report, **seven}, {}, seven, {}, seven]


def test_the_collision_rule_is_that_of_training_unless_said(monkeypatch, capsys):
    played = []

    def note(policy, *, options, **settings):
        played.append(options)
        return evaluate(policy, options=options, **settings)

    monkeypatch.setattr(evaluate_cli, "evaluate", note)
    for given in ([], ["--collisions", "false"], ["--collisions", "true"]):
        assert main(["evaluate", "ppo-moving", "--goals", "1", *given]) == 0
        assert " ".join(given) in capsys.readouterr().out
    assert played == [{}, {"collisions": False}, {"collisions": True}]


@pytest.mark.parametrize(
    "options", [{"max_episode_steps": "many"}, {"max_episode_steps": None}, {"actuation": ["report"]}]
)
def test_a_card_with_options_that_nothing_takes_is_one_line(options, tmp_path, capsys):
    copy_policy("button", tmp_path / "odd.safetensors", recipe={"options": options})
    assert main(["evaluate", str(tmp_path / "odd.safetensors"), "--goals", "1"]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert next(iter(options)).replace("_", " ").split()[-1] in errors


@pytest.mark.slow
def test_going_on_with_other_code_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(provenance, "source_digest", lambda: "0123456789ab")
    recipe = small("ranked-single")
    interrupted(recipe, tmp_path / "ranked-single/seed-4", 1)
    monkeypatch.undo()
    monkeypatch.setattr(train_cli, "get_recipe", lambda name: recipe)
    assert main(["train", "ranked-single", "--seed", "4", "--out", str(tmp_path), "--resume"]) == 0
    notice, *progress = capsys.readouterr().err.splitlines()
    assert "was made by other code of kinreach (0123456789ab, now " in notice
    assert all(re.match(r"\S+, seed 4: \d+ % reward ", line) for line in progress)


def test_without_a_terminal_a_training_prints_a_line_for_every_tenth(tmp_path, monkeypatch, capsys):
    def train(recipe, folder, *, progress, **options):
        for done in range(4, 101, 4):
            progress(done, 100, {"reward": 0.5 * done, "reached": None, "distance": 0.1 / done})
        raise InputError("enough")

    monkeypatch.setattr("kinreach.baselines._training.train", train)
    assert main(["train", "ranked-single", "--seed", "3", "--out", str(tmp_path)]) == 2
    *lines, _ = capsys.readouterr().err.splitlines()
    assert lines[:2] == [
        "ranked-single, seed 3: 10 % reward 6.00 a step, 8.3 mm",
        "ranked-single, seed 3: 20 % reward 10.00 a step, 5.0 mm",
    ]
    assert len(lines) == 10


def test_without_the_extra_training_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "kinreach.baselines._training", None)
    assert main(["train", "ranked-single"]) == 2
    assert "pip install 'kinreach[train]'" in capsys.readouterr().err


def test_help_lists_the_recipes(capsys):
    with pytest.raises(SystemExit) as leaving:
        main(["train", "--help"])
    assert leaving.value.code == 0
    assert "thesis-ppo-single" in capsys.readouterr().out


@pytest.mark.slow
def test_a_bar_shows_each_seed_and_how_far_it_is(tmp_path, monkeypatch, capsys):
    calls = []

    class Bar:
        def __init__(self, *columns, disable, **options):
            calls.append((len(columns), disable, options["transient"]))

        def __enter__(self):
            return self

        def __exit__(self, *error):
            calls.append("closed")

        def add_task(self, description, **options):
            return 7

        def reset(self, task, *, description):
            calls.append((task, description))

        def update(self, task, *, completed, total, figures):
            calls.append((task, completed, total, figures.split()[0] if figures else ""))

    monkeypatch.setattr(train_cli, "Progress", Bar)
    monkeypatch.setattr(train_cli, "GOALS", 10)
    assert (
        main(["train", "ranked-single", "--steps", "2048", "--seeds", "2", "--seed", "3", "--out", str(tmp_path)]) == 0
    )
    assert (calls[0], calls[-1]) == ((6, True, True), "closed")
    assert [each for each in calls if each[1:] in (("ranked-single, seed 3",), ("ranked-single, seed 4",))] == [
        (7, "ranked-single, seed 3"), (7, "ranked-single, seed 4"),
    ]  # fmt: skip
    said = capsys.readouterr().out
    assert f"{tmp_path / 'ranked-single' / 'seed-4'}: " in said
    assert "seed 3" in said
    assert "evaluate " in said


def test_a_terminal_shows_what_share_is_done_of_what_is_planned(tmp_path, monkeypatch):
    """Read from what is drawn: the seed, per cent, and the figures of the last row; no lines of a log."""

    def train(recipe, folder, *, progress, **options):
        for done in (10, 25, 40):
            progress(done, 160, {"reward": 0.5 * done, "reached": None, "distance": None})
        raise InputError("enough")

    class Bar(Progress):
        def update(self, task, **given):
            super().update(task, **given)
            self.refresh()

    file = io.StringIO()
    monkeypatch.setattr("kinreach.baselines._training.train", train)
    monkeypatch.setattr(train_cli, "Progress", Bar)
    monkeypatch.setattr(train_cli, "Console", lambda **options: Console(file=file, force_terminal=True, width=120))
    assert main(["train", "ranked-single", "--seed", "3", "--out", str(tmp_path)]) == 2
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", file.getvalue())
    drawn = [line.split() for line in re.split(r"[\r\n]", text) if " % " in line]
    shares = [int(words[words.index("%") - 1]) for words in drawn]
    assert sorted(set(shares)) == [0, 6, 16, 25]
    assert shares == sorted(shares)
    assert all(words[:3] == ["ranked-single,", "seed", "3"] for words in drawn[1:])
    assert drawn[-1][-4:] == ["reward", "20.00", "a", "step"]


def test_what_a_bar_says_of_a_row():
    nothing = dict.fromkeys(("reward", "reached", "distance", "steps"))
    assert train_cli._figures(nothing) == ""
    assert train_cli._figures({**nothing, "reached": 0.256}) == "reached 26 %"
    whole = {"reward": -1.234, "reached": 1.0, "distance": 0.01234, "steps": 3}
    assert train_cli._figures(whole) == "reward -1.23 a step, reached 100 %, 12.3 mm"


def test_an_engine_and_its_address_are_passed_on(monkeypatch, tmp_path):
    asked = []

    def engine(*given):
        asked.append(given)
        raise InputError("no engine")

    monkeypatch.setattr(train_cli, "open_engine", engine)
    command = ["train", "ranked-single", "--out", str(tmp_path)]
    assert main(command) == main([*command, "--engine", "ray", "--address", "h:1"]) == 2
    assert asked == [("serial", None), ("ray", "h:1")]


def test_the_command_that_goes_on_has_the_arguments_of_the_interrupted_one():
    """Whichever were given; read again they are the same, with --resume."""
    rng, seen = np.random.default_rng(0), []
    parser = train_cli._parser("train")
    choices = {
        "--seed": "7", "--seeds": "3", "--steps": "640", "--threads": "2", "--engine": "processes",
        "--picture": "a.png", "--from": "ppo-single", "--export": None,
    }  # fmt: skip
    for _ in range(40):
        given = [name for name in choices if rng.random() < 0.5]
        words = [word for name in given for word in (name, choices[name]) if word is not None]
        arguments = parser.parse_args(["ppo-multi", *words, "--out", "there"])
        again = train_cli._again(arguments)
        assert vars(parser.parse_args(again)) == vars(arguments) | {"resume": True}
        assert again.count("--resume") == 1
        assert len(again) == len(words) + 4 + 2 * ("--seed" not in given)
        seen += given
    assert min(seen.count(name) for name in choices) >= 10

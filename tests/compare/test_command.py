"""The command inside: widths, default folders, what is played again, flags of other people's tasks."""

import json
import re
import shlex
import sys
from pathlib import Path

import gymnasium as gym
import pytest

from kinreach import cli
from kinreach.compare import _cli, get_task
from kinreach.compare import _runner as runner
from kinreach.compare import _task as registry
from kinreach.compare._runner import RECORDS
from kinreach.compare.inside import OptionFlags
from tests.compare.failing_methods import FAILING
from tests.policy_files import copy_policy


def call(*argv):
    return cli.main(["compare", *argv])


@pytest.mark.usefixtures("without_pictures")
def test_no_number_of_a_table_is_cut(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(_cli, "TABLE_WIDTH", 20)
    assert call("--methods", "closed-form", "--goals", "2", "--out", str(tmp_path / "a")) == 0
    said = capsys.readouterr().out
    assert "…" not in said
    assert re.search(r"closed-form +100\.0 \[34\.2, 100\.0\] +0\.\d+ / 0\.\d+ +100\.0 +0\.0 ", said)


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


OTHER_SETTINGS = [
    ["--task", "ur5", "--methods", "closed-form,lm"],
    ["--goals", "2"],
    ["--seed", "7"],
    ["--methods", "closed-form"],
    ["--methods", "lm"],
    ["--methods", "closed-form", "--goals", "2", "--seed", "7"],
    ["--methods", "mine:look"],
    ["--methods", "other/mine.safetensors"],
    ["--methods", "another/mine.safetensors"],
    ["--methods", "closed-form", "--arm", "ur3"],
    ["--methods", "closed-form", "--arm", "ur3", "--goals", "2"],
    ["--task", "button", "--methods", "random"],
    ["--task", "button", "--methods", "random", "--max-episode-steps", "7"],
    ["--task", "button", "--methods", "random", "--max-episode-steps", "8"],
]


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_no_default_folder_is_that_of_other_settings(tmp_path, monkeypatch, capsys):
    """As `make compare` and then other commands in the same folder: what was finished stays, byte for byte."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("kinreach.compare._cli.DEFAULT_GOALS", 1)  # 200 take a while
    (tmp_path / "mine.py").write_text("import numpy as np\n\ndef look(observation):\n    return np.zeros(6)\n")
    for folder in ("other", "another"):
        (tmp_path / folder).mkdir()
        copy_policy("ranked-single", tmp_path / folder / "mine.safetensors")
    results = tmp_path / "results"
    assert call() == 0
    assert (results / "compare-ur5" / "results.json").is_file()
    kept = contents(results)
    for number, argv in enumerate(OTHER_SETTINGS, 2):
        assert call(*argv) == 0, argv
        now = contents(results)
        assert {name: now[name] for name in kept} == kept, argv
        assert len([name for name in now if name.endswith("results.json")]) == number, argv
        kept = now
    names = {path.name for path in results.iterdir()}
    assert {"compare-ur5-closed-form+lm", "compare-ur5-goals2", "compare-ur5-closed-form-goals2-seed7"} < names
    assert {"compare-ur5-seed7", "compare-ur5-ur3-closed-form", "compare-button-random-max_episode_steps7"} < names
    assert call("--methods", "lm") == 0  # the same again is measured again, in its own folder
    assert {path.name for path in results.iterdir()} == names
    capsys.readouterr()


@pytest.mark.usefixtures("without_pictures")
def test_trials_that_were_finished_before_a_method_raised_are_kept(tmp_path, monkeypatch, capsys):
    """Also once the method is mended: those of the others."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "failing", raising=False)
    module = tmp_path / "failing.py"
    module.write_text(FAILING.format(calls=10))
    argv = ["--methods", "closed-form,failing:Fails", "--goals", "5", "--out", "here"]
    assert call(*argv) == cli.EXIT_ERROR
    assert "finished trials are kept in here" in capsys.readouterr().err
    lines = [json.loads(line) for line in (tmp_path / "here" / RECORDS).read_text().splitlines()[1:]]
    done = [trial for trial in lines if trial["method"] == "closed-form"]
    assert len(done) in (3, 4)
    assert len(lines) - len(done) == 3  # 2 decisions a goal, 4 of the warm-up
    monkeypatch.delitem(sys.modules, "failing")
    module.write_text(FAILING.format(calls=10_000))
    pending, play = [], runner.play

    def listed(comparison, goals):
        pending.extend(name for _, _, names in goals for name in names)
        return play(comparison, goals)

    monkeypatch.setattr(runner, "play", listed)
    assert call(*argv) == 0
    assert (pending.count("closed-form"), pending.count("Fails")) == (5 - len(done), 5)


FOREIGN = """
from dataclasses import dataclass, field, replace

import gymnasium as gym

from tests.compare.conftest import ToyEnv, toy_task


@dataclass(frozen=True)
class FarOptions:
    offset: float = field(default=0.0, metadata={"description": "added to every action [m], 100 % of them"})
    steps: int = 1
    names: tuple[str, ...] = ("a", "b")
    loud: bool = False
    wide: float | None = None
    goals: int = 3
    shape: object = None


class FarEnv(ToyEnv):
    Options = FarOptions

    def __init__(self, render_mode=None, **options):
        given = FarOptions(**options)
        assert given.steps == 1 or (given.names, given.loud, given.wide) == (("x", "y", "z"), True, 0.5)
        super().__init__(render_mode, given.offset)


gym.register("far/Toy-v0", entry_point=FarEnv)
TASK = replace(toy_task(), name="far", environment="far/Toy-v0", options={"offset": 0.001})
"""


@pytest.fixture
def foreign(tmp_path, monkeypatch, root):
    monkeypatch.syspath_prepend(str(root))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "far_away.py").write_text(FOREIGN)
    yield "far_away:TASK"
    registry._TASKS.pop("far", None)
    gym.registry.pop("far/Toy-v0", None)
    sys.modules.pop("far_away", None)


def test_options_of_a_foreign_task_come_from_its_dataclass(foreign, tmp_path, capsys):
    with pytest.raises(SystemExit):
        call("--task", foreign, "--help")
    said = " ".join(capsys.readouterr().out.split())
    assert "options of the task far: --offset X added to every action [m], 100 % of them (default: 0.001)" in said
    for words in ("--steps N (default: 1)", "--names NAME,NAME (default: a,b)", "--loud true|false", "--wide X"):
        assert words in said
    assert said.count("--goals N") == 2  # in the usage and in its line: that of the comparison
    assert "--shape" not in said
    assert "--speeds" not in said
    given = ["--offset", "0.005", "--steps", "2", "--names", "x,y,z", "--loud", "true", "--wide", "0.5"]
    assert call("--task", foreign, "--goals", "2", "--out", "here", *given) == 0
    assert " ".join(given) in " ".join(capsys.readouterr().out.split())
    found = json.loads((tmp_path / "here" / "results.json").read_text())
    assert found["settings"]["options"] == {
        "offset": 0.005, "steps": 2, "names": ["x", "y", "z"], "loud": True, "wide": 0.5,
    }  # fmt: skip
    assert found["methods"][0]["distance_mm"]["median"] == pytest.approx(5.0)


def test_the_command_that_is_printed_means_the_same():
    """Of all flags, but for those that do not change the results; values have spaces and quotes."""
    parser, left_out = _cli._parser("kinreach compare"), {"fresh", "engine", "address"}
    given = ["--task", "button"]
    for action in parser._actions:
        if action.dest not in {"help", "task", *left_out}:
            value = {"goals": "7", "seed": "3", "observation": "camera"}.get(action.dest, f"a 'b' {action.dest}")
            given += [action.option_strings[0], *([] if action.nargs == 0 else [value])]
    flags = OptionFlags(get_task("button").environment, {})
    texts = {name: f"{name} x" for name in flags}
    arguments = parser.parse_args(given)
    words = shlex.split(_cli._command("it", arguments, flags, texts, Path(arguments.out)))
    repeated, rest = parser.parse_known_args(words[1:])
    assert vars(repeated) == vars(arguments)
    assert rest == [word for name, text in texts.items() for word in (flags[name].spelled, text)]
    assert len(vars(arguments)) > 15
    plain = parser.parse_args([])
    assert _cli._command("it", plain, {}, {}, None) == "it --task ur5 --goals 200 --seed 0"

"""The console script itself: its help, its version, its list of commands."""

from __future__ import annotations

import re

import pytest

import kinreach
from kinreach import cli


@pytest.mark.parametrize("flag", ["--version", "-V"])
def test_version(flag, capsys):
    assert cli.main([flag]) == 0
    assert capsys.readouterr().out == f"kinreach {kinreach.__version__}\n"


def test_without_arguments_it_prints_its_help(capsys):
    assert cli.main([]) == 0
    bare = capsys.readouterr().out
    with pytest.raises(SystemExit) as leaving:
        cli.main(["--help"])
    assert leaving.value.code == 0
    assert capsys.readouterr().out == bare
    assert bare.startswith("usage: kinreach [-h] [-V] COMMAND ...")
    assert bare == bare.rstrip() + "\n"
    assert all(re.search(rf"  {name} +{re.escape(command.help)}\n", bare) for name, command in cli.COMMANDS.items())
    assert "bench" not in cli.COMMANDS


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_its_help(name, capsys):
    with pytest.raises(SystemExit) as leaving:
        cli.main([name, "-h"])
    assert leaving.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: kinreach {name} ")


@pytest.mark.parametrize("argument", ["bench", "nonsense", "--nonsense"])
def test_what_is_no_command_is_one_line(argument, capsys):
    with pytest.raises(SystemExit) as leaving:
        cli.main([argument])
    assert leaving.value.code == cli.EXIT_ERROR
    said = capsys.readouterr().err
    assert said.startswith("kinreach: error: ")
    assert said.count("\n") == 1

"""The console script itself: its help, its version, its list of commands."""

from __future__ import annotations

import errno
import os
import re
import sys
from types import SimpleNamespace

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


def test_what_was_printed_is_written_out_before_the_exit_code(monkeypatch):
    written = []
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(flush=lambda: written.append(1)))
    assert cli.finish(lambda: 3, prog="it") == 3
    assert written == [1]


@pytest.mark.parametrize(
    ("number", "code"), [(errno.ENOSPC, 2), (errno.EDQUOT, 2), (errno.EROFS, 2), (errno.EFBIG, 2), (errno.EIO, None)]
)
def test_a_full_disk_is_one_line_and_other_errors_are_raised(number, code, capfd):
    def fails():
        raise OSError(number, os.strerror(number))

    if code is None:
        with pytest.raises(OSError, match="Input/output error"):
            cli.finish(fails, prog="it")
    else:
        assert cli.finish(fails, prog="it") == code
        assert capfd.readouterr().err == f"it: error: cannot write: {os.strerror(number)}\n"


def test_words_are_quoted_for_a_shell():
    assert [cli.quoted(word) for word in ("a", "a b", "it's")] == ["a", "'a b'", "'it'\"'\"'s'"]
    assert cli.quoted("a\x1bb'\\\u2028") == "$'a\\x1bb\\'\\\\\\xe2\\x80\\xa8'"


def test_a_negative_list_after_a_flag_is_its_value():
    parser = cli.Parser(prog="it")
    parser.add_argument("--at")
    parser.add_argument("--to")
    parser.add_argument("names", nargs="*")
    found = parser.parse_args(["--at", "-0.4,1", "--to=3", "x"])
    assert (found.at, found.to, found.names) == ("-0.4,1", "3", ["x"])
    assert parser.parse_args(["--at", "-.5e-3,1"]).at == "-.5e-3,1"
    with pytest.raises(SystemExit):
        parser.parse_args(["--at", "-x"])


def test_keywords_in_messages_are_flags():
    assert (
        cli.in_flags("give tip=NAME, repair=True or mesh_scale=2") == "give --tip NAME, --repair or --tool-mesh-scale 2"
    )
    assert cli.in_flags("package_dirs=[A]") == "--package-dir [A]"
    assert cli.in_flags("with package_dirs=, or tip=") == "with --package-dir, or --tip"
    assert cli.in_flags("held={'rail': 0.2} does; held= too") == "--hold rail=0.2 does; --hold too"
    assert cli.in_flags("""held={"it's": 0.2}""") == """--hold 'it'"'"'s=0.2'"""

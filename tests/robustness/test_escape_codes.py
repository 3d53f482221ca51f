"""Names of files with escape codes reach neither a terminal nor a text file: a terminal would obey them."""

import subprocess

import pytest

from kinreach._checks import printable
from kinreach.cli import main, quoted
from tests.policy_files import copy_policy

#: Clears the screen, sets the title, and turns text red; the second byte form of the same.
NAME = "a\x1b[2J\x1b]0;owned\x07\x1b[31m\x9b31mb'\\c"
#: What terminals obey, without ends of lines and tabs, which texts have.
OBEYED = [chr(code) for code in (*range(0x09), *range(0x0B, 0x20), *range(0x7F, 0xA0), 0x202E)]


def clean(text):
    return not any(sign in text for sign in OBEYED)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    copy_policy("ranked-single", tmp_path / f"{NAME}.safetensors")
    return tmp_path


def commands():
    policy, urdf = f"{NAME}.safetensors", f"{NAME}.urdf"
    yield ["compare", "--methods", "closed-form", "--goals", "1", "--out", NAME], 0
    yield ["compare", "--methods", "closed-form", "--goals", "2", "--out", NAME], 2
    yield ["compare", "--methods", policy, "--goals", "1"], 2
    yield ["compare", "--methods", "closed-form", "--goals", "1", "--arm", f"missing{urdf}"], 2
    yield ["evaluate", policy, "--goals", "2", "--backend", "kinematic", "--out", f"{NAME}.json"], 0
    yield ["evaluate", f"missing{policy}"], 2
    yield ["check", f"missing{urdf}"], 2
    yield ["demo", "--policy", policy, "--steps", "1", "--backend", "kinematic"], 0
    yield ["demo", "--policy", f"missing{policy}"], 2
    yield ["view", "--results", NAME + ".json"], 2
    yield ["train", "ranked-single", "--steps", "1", "--out", f"{NAME}.json"], 2


@pytest.mark.slow
def test_no_command_hands_escape_codes_on(here, capfd):
    tried = 0
    for argv, code in commands():
        assert main(argv) == code, argv
        said = capfd.readouterr()
        assert clean(said.out), argv
        assert clean(said.err), argv
        tried += NAME in " ".join(argv)
    assert tried >= 10
    written = [path for path in here.rglob("*") if path.suffix in (".json", ".csv", ".html") and path.is_file()]
    assert len(written) >= 4
    for path in written:
        assert clean(path.read_text(encoding="utf-8")), path.suffix


@pytest.mark.slow
def test_training_into_a_folder_with_escape_codes(here, capfd):
    pytest.importorskip("stable_baselines3")
    assert main(["train", "ranked-single", "--steps", "1", "--out", NAME]) == 0
    said = capfd.readouterr()
    assert "owned" in said.out
    assert clean(said.out + said.err)
    written = [path for path in (here / NAME).rglob("*") if path.suffix in (".json", ".csv")]
    assert len(written) >= 2
    assert all(clean(path.read_text(encoding="utf-8")) for path in written)


@pytest.mark.parametrize("word", [NAME, "plain", "two words", "it's", "ä ö", "", "a\nb", "\\", "\x1b'"])
def test_a_quoted_word_is_printable_and_means_the_same_to_a_shell(word):
    said = quoted(word)
    assert clean(said)
    assert said.isprintable()
    done = subprocess.run(["bash", "-c", f"printf %s {said}"], capture_output=True, check=True)
    assert done.stdout.decode() == word


def test_what_is_printable_stays():
    text = "Grüße, 30 °, ±π\n\tnext"
    assert printable(text) == text
    assert printable(f"x{NAME}") == "xa\\x1b[2J\\x1b]0;owned\\x07\\x1b[31m\\x9b31mb'\\c"
    assert all(clean(printable(sign)) for sign in OBEYED)

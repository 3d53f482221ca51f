"""`python -m benchmarks.speed`: results, interruptions, and what it says when it is used wrongly."""

import json
import re
from pathlib import Path

import jsonschema
import pytest

import benchmarks.speed
from benchmarks.speed.report import markdown, pictures_of
from benchmarks.speed.suites import SUITES, load_suite
from kinreach import cli
from kinreach.errors import InstallationError

PROG = "python -m benchmarks.speed"
SCHEMA = Path(benchmarks.speed.__file__).with_name("results.schema.json")


def call(*argv: str) -> int:
    try:
        return cli.run("benchmarks.speed.cli", argv, prog=PROG)
    except SystemExit as leaving:
        return int(leaving.code or 0)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def results(out):
    return json.loads((out / "results.json").read_text(encoding="utf-8"))


def test_results(suites, out, capsys):
    suites["charts"] = True
    assert call("--out", str(out), "--seed", "4") == 0
    said = capsys.readouterr().out
    assert suites["played"] == ["one", "two", "three"]
    assert sorted(path.name for path in out.iterdir()) == ["figures", "results.json", "results.md"]
    found = results(out)
    jsonschema.validate(found, json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert found["options"] == {"rounds": 7, "quick": False, "seed": 4}
    assert found["command"] == "python -m benchmarks.speed --seed 4"
    assert list(found["suites"]) == ["one", "two", "three"]
    assert [target["met"] for target in found["suites"]["one"][0]["targets"]] == [True, False]
    assert found["versions"]["EAIK"]
    assert found["machine"]["cores"]
    assert "Targets: 3 of 6 met" in said
    assert "Missing: absent: not installed (no module absent)" in said
    assert (out / "results.md").read_text() == markdown(
        found, data="results.json", pictures=pictures_of(found, out / "results.md", out / "figures")
    )


@pytest.mark.parametrize(
    ("argv", "command", "rounds"),
    [
        (("--suite", "three, one"), "python -m benchmarks.speed --suite one,three", 7),
        (("--quick",), "python -m benchmarks.speed --quick", 3),
        (("--quick", "--rounds", "2"), "python -m benchmarks.speed --quick --rounds 2", 2),
        (("--suite", "one,two,three", "--rounds", "7"), "python -m benchmarks.speed", 7),
    ],
)
def test_command_in_the_results(suites, out, argv, command, rounds):
    assert call(*argv, "--out", str(out)) == 0
    assert results(out)["command"] == command
    assert results(out)["options"]["rounds"] == rounds


def test_page_of_the_documentation(suites, out, tmp_path):
    suites["charts"] = True
    page = tmp_path / "docs" / "speed.md"
    assert call("--out", str(out), "--docs", str(page)) == 0
    data = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert data == results(out)
    pictures = pictures_of(data, page, page.parent / "images" / "speed")
    assert page.read_text(encoding="utf-8") == markdown(data, data="speed.json", pictures=pictures)
    assert len(pictures) == 3
    assert all((page.parent / picture).stat().st_size > 1000 for picture in pictures.values())


def test_a_page_is_drawn_again_from_its_numbers(suites, out, tmp_path, capsys):
    suites["charts"] = True
    page = tmp_path / "docs" / "speed.md"
    assert call("--out", str(out), "--docs", str(page)) == 0
    written, played = page.read_text(encoding="utf-8"), list(suites["played"])
    page.write_text("stale")
    assert call("--redraw", "--docs", str(page)) == 0
    assert page.read_text(encoding="utf-8") == written
    assert suites["played"] == played
    assert call("--redraw") == 2
    assert "--redraw needs the page" in capsys.readouterr().err


def test_a_picture_of_an_earlier_run_does_not_stay(suites, out, capsys):
    suites["charts"] = True
    assert call("--out", str(out)) == 0
    assert f"{out}/figures" in capsys.readouterr().out
    assert len([*(out / "figures").iterdir()]) == 3
    suites["charts"] = False
    assert call("--out", str(out)) == 0
    assert "figures" not in capsys.readouterr().out
    assert sorted(path.name for path in out.rglob("*") if path.is_file()) == ["results.json", "results.md"]


class TestInterruption:
    @pytest.fixture
    def interrupted(self, suites, out, capsys):
        def stop(options, progress):
            raise KeyboardInterrupt

        working, suites["runs"]["two"] = suites["runs"]["two"], stop
        assert call("--out", str(out)) == cli.EXIT_INTERRUPTED
        err = capsys.readouterr().err
        assert err == (f"{PROG}: interrupted; 1 of 3 suites are kept in {out}; the same command goes on from there\n")
        assert suites["played"] == ["one"]
        assert not (out / "results.json").exists()
        suites["runs"]["two"] = working
        return suites["played"]

    def test_the_same_command_goes_on(self, interrupted, out, capsys):
        assert call("--out", str(out)) == 0
        assert interrupted == ["one", "two", "three"]
        assert "one: kept from an interrupted run" in capsys.readouterr().err
        assert list(results(out)["suites"]) == ["one", "two", "three"]
        assert not (out / "unfinished.json").exists()
        assert call("--out", str(out)) == 0
        assert interrupted == ["one", "two", "three"] * 2, "a finished run is not gone on from"

    def test_seconds_are_of_all_suites(self, suites, interrupted, out):
        kept = json.loads((out / "unfinished.json").read_text())
        kept["seconds"]["one"] += 100.0
        (out / "unfinished.json").write_text(json.dumps(kept))
        assert call("--out", str(out)) == 0
        assert interrupted == ["one", "two", "three"]
        assert 100.0 <= results(out)["seconds"] < 110.0

    @pytest.mark.parametrize("argv", [("--seed", "1"), ("--rounds", "2"), ("--quick",), ("--fresh",)])
    def test_other_options_start_over(self, interrupted, out, argv):
        assert call("--out", str(out), *argv) == 0
        assert interrupted == ["one", "one", "two", "three"]

    @pytest.mark.parametrize("damage", [b"", b"{", b"[]", b"[" * 100_000, b"\xff\xfe", None])
    def test_a_damaged_file_starts_over(self, interrupted, out, capsys, damage):
        file = out / "unfinished.json"
        if damage is None:
            kept = json.loads(file.read_text())
            del kept["suites"]["one"][0]["rows"]
            damage = json.dumps(kept).encode()
        file.write_bytes(damage)
        assert call("--out", str(out)) == 0
        assert re.search(r"unfinished\.json cannot be read \(\w+\):\s+starting over", capsys.readouterr().err)
        assert interrupted == ["one", "one", "two", "three"]


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--suite", "chess"], "unknown suite 'chess'; available: one, three, two"),
        (["--suite", "one,chess"], "unknown suite 'chess'"),
        (["--suite", ","], "no suite given; available: one, two, three"),
        (["--rounds", "0"], "rounds must be at least 1, got 0"),
        (["--rounds", "few"], "argument --rounds: invalid int value: 'few'"),
        (["--seed", "-1"], "the seed must be at least 0, got -1"),
        (["--fast"], "unrecognized arguments: --fast"),
        (["--out", "/proc/nowhere"], "cannot write /proc/nowhere"),
        (["--docs", "/proc/nowhere/page.md"], "cannot write /proc/nowhere"),
        (["--out", "a\0b"], "--out cannot be a path, got 'a\\x00b': a path has no null character"),
        (["--docs", "a\0b"], "--docs cannot be a path"),
        (["--docs", "x" * 300], "--docs cannot be a path"),
        (["--docs", "/"], "--docs must be a file, got '/'"),
        (["--docs", ""], "--docs must be a file, got ''"),
        (["--docs", "/dev/full"], "--docs must be a file, got '/dev/full'"),
        (["--docs", "page.json"], "--docs must be a page of Markdown; its numbers go to page.json"),
    ],
)
def test_bad_input_is_one_clear_line(suites, capsys, argv, said):
    assert call(*argv) == cli.EXIT_ERROR
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("python -m benchmarks.speed: error: ")
    assert said in err
    assert err.count("\n") == 1
    assert suites["played"] == []


def test_a_suite_that_cannot_run_keeps_the_others(suites, out, capsys):
    def broken(options, progress):
        raise InstallationError("cannot import placo:\n it is missing")

    suites["runs"]["three"] = broken
    assert call("--out", str(out)) == cli.EXIT_ERROR
    err = capsys.readouterr().err
    assert err == "python -m benchmarks.speed: error: cannot import placo: it is missing\n"
    assert list(json.loads((out / "unfinished.json").read_text())["suites"]) == ["one", "two"]


def test_every_suite_exists():
    assert list(SUITES) == [
        "ik-single", "ik-edge-cases", "ik-batch", "ik-calibrated", "ik-arms", "fk-batch", "env", "train", "compare",
        "startup", "growth",
    ]  # fmt: skip
    for name, summary in SUITES.items():
        assert summary
        assert callable(load_suite(name))


def test_help_loads_nothing_heavy(run_python):
    code = (
        "import sys\nfrom kinreach import cli\n"
        "try:\n    cli.run('benchmarks.speed.cli', ['--help'], prog='speed')\nexcept SystemExit: pass\n"
        "print(sorted({'pinocchio', 'mujoco', 'torch', 'eaik'} & set(sys.modules)))"
    )
    done = run_python("-c", code)
    assert done.returncode == 0, done.stderr
    assert "ik-single" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"

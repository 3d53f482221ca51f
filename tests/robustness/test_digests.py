"""Digests of results, which are to be the same wherever they are computed."""

import sys

import pytest

from tools import digest


@pytest.mark.parametrize("name", ["forward", "closed_form", "arm3", "moves", "policies"])
def test_digests_repeat(name):
    first, again = (digest.digests(digest.RESULTS[name]) for _ in range(2))
    assert first == again
    assert first[2] > 100


@pytest.mark.parametrize("name", digest.RESULTS)
@pytest.mark.slow
def test_results_are_those_that_are_kept(name):
    """Rounded: the last bits depend on the processor. docs/reference/promises.md says how to keep them anew."""
    assert digest.compare(name, digest.digests(digest.RESULTS[name]), digest.read(digest.REFERENCE)) in (
        digest.EXACT,
        digest.ROUNDED,
    )


def test_no_other_results_are_kept():
    assert digest.read(digest.REFERENCE).keys() == digest.RESULTS.keys()
    assert "nearest" in digest.RESULTS


def test_digests_tell_results_apart(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(digest, "RESULTS", {"one": lambda: iter([[1.0, 2.0]]), "two": lambda: iter([[3.0]])})
    monkeypatch.setattr(sys, "argv", ["digest"])
    assert digest.main() == 0
    (tmp_path / "known").write_text(capsys.readouterr().out)
    monkeypatch.setattr(sys, "argv", ["digest", "--check", str(tmp_path / "known")])
    assert digest.main() == 0
    assert capsys.readouterr().out.count("same bits") == 2
    for changed, code, verdict in ((3.0 + 1e-13, 0, "same to 1e-9"), (3.0 + 1e-6, 1, "DIFFERENT")):
        monkeypatch.setitem(digest.RESULTS, "two", lambda changed=changed: iter([[changed]]))
        assert digest.main() == code
        assert verdict in capsys.readouterr().out


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([], ["one MISSING", "two MISSING"]),
        (["# a comment", ""], ["one MISSING", "two MISSING"]),
        (["no digests here"], ["one MISSING", "two MISSING", "no MISSING"]),
        (["One 0 0 1"], ["one MISSING", "two MISSING", "One MISSING"]),
        ([0], ["two MISSING"]),
        ([0, 1, "three 0123456789abcdef 0123456789abcdef 1"], ["three MISSING"]),
        ([0, 1], []),
        ([1, 0], []),
    ],
)
def test_a_result_that_only_one_of_two_runs_has_is_a_difference(lines, said, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(digest, "RESULTS", {"one": lambda: iter([[1.0, 2.0]]), "two": lambda: iter([[3.0]])})
    monkeypatch.setattr(sys, "argv", ["digest"])
    assert digest.main() == 0
    printed = [line for line in capsys.readouterr().out.splitlines() if not line.startswith("#")]
    known = "\n".join(printed[line] if isinstance(line, int) else line for line in lines)
    (tmp_path / "known").write_text(known)
    monkeypatch.setattr(sys, "argv", ["digest", "--check", str(tmp_path / "known")])
    assert digest.main() == int(bool(said))
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [f"{row[0]} MISSING" for row in rows if "MISSING" in row] == said

"""Where the numbers come from, as it is written beside them."""

import platform
from pathlib import Path

import numpy as np
import pytest

import kinreach
from kinreach import _provenance as provenance


def test_versions_are_those_that_are_installed() -> None:
    versions = provenance.versions()
    assert versions["python"] == platform.python_version()
    assert versions["numpy"] == np.__version__
    assert all(versions[name] for name in ("pin", "placo", "mujoco"))


def test_the_digest_tells_two_states_of_the_code_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for state, (name, text) in enumerate((("solver.py", "x = 1\n"), ("solver.py", "x = 2\n"), ("other.py", "x = 2\n"))):
        package = tmp_path / str(state)
        package.mkdir()
        (package / "__init__.py").write_text("")
        (package / name).write_text(text)
        monkeypatch.setattr(kinreach, "__file__", str(package / "__init__.py"))
        found.append(provenance.source_digest())
        (package / name).write_text("not what was loaded\n")
        assert provenance.source_digest() == found[-1]
    assert {len(each) for each in found} == {12}
    assert len(set(found)) == 3


def test_the_machine_has_a_name() -> None:
    machine = provenance.machine()
    assert machine["processor"]
    assert platform.system() in str(machine["system"])


@pytest.mark.parametrize(("known", "name"), [("x86_64", "x86_64"), ("", "unknown")])
def test_a_processor_without_a_name_is_the_systems(known: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object, **__: object) -> str:
        raise OSError

    monkeypatch.setattr(Path, "read_text", missing)
    monkeypatch.setattr(platform, "processor", lambda: known)
    assert provenance.machine()["processor"] == name


def test_a_digest_is_of_all_contents() -> None:
    assert provenance.digest(b"abc") == provenance.digest(b"a", b"bc") == "ba7816bf8f01"
    assert provenance.versions(["no-such-package"])["no-such-package"] is None

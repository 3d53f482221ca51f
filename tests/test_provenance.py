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
    monkeypatch.setattr(kinreach, "__file__", str(tmp_path / "__init__.py"))
    (tmp_path / "__init__.py").write_text("")
    (tmp_path / "solver.py").write_text("x = 1\n")
    first = provenance.source_digest()
    assert provenance.source_digest() == first
    assert len(first) == 12
    (tmp_path / "solver.py").write_text("x = 2\n")
    second = provenance.source_digest()
    (tmp_path / "solver.py").rename(tmp_path / "other.py")
    assert len({first, second, provenance.source_digest()}) == 3


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

"""Names of version 0.1.0: each goes on importing from its old place, and says where it is now."""

from __future__ import annotations

import importlib
import json
import sys
import warnings
from pathlib import Path
from types import ModuleType

import pytest

from kinreach import _moved

#: What is deliberately not tried: speed is no part of the package any more, and of `kinreach.compare` only what
#: `__all__` said was for its users (its modules were the inside of one command, and have become other ones). The
#: list also leaves out what held an imported engine, such as `pin`, and `load_checkpoint` of
#: `kinreach.baselines.checkpoint`, of which `train(..., resume=True)` is what remains.
EXCLUDED = ("kinreach.bench", "kinreach.compare.")

#: Imports every name through its old path, in a fresh interpreter.
WALK = """
import importlib, json, sys, warnings

failed, tried, warned = [], 0, {}
for line in sys.stdin.read().splitlines():
    module, _, names = line.partition(":")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for name in names.split():
            tried += 1
            try:
                exec(f"from {module} import {name}", {})
            except Exception as error:
                failed.append(f"{module}.{name}: {type(error).__name__}: {error}")
    warned[module] = [str(w.message) for w in caught if " is now " in str(w.message)]
print(json.dumps([failed, tried, warned]))
"""

#: A module that has a `__getattr__` of its own.
LATE = """
kept = 3

def __getattr__(name):
    if name == "late":
        return 4
    raise AttributeError(name)
"""


@pytest.fixture(scope="module")
def old_names() -> list[str]:
    lines = (Path(__file__).parent / "data" / "public_names_0_1.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if not line.startswith("#")]


@pytest.fixture
def moved(monkeypatch, tmp_path):
    """A package `house` whose module `new` has taken over from `old`, and a name from `open`."""
    house = tmp_path / "house"
    house.mkdir()
    (house / "__init__.py").touch()
    (house / "new.py").write_text("value = 1\nfresh = 2\n", encoding="utf-8")
    (house / "open.py").write_text(LATE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(_moved.MODULES, "house.old", "house.new")
    monkeypatch.setitem(_moved.NAMES, "house.old.aged", "house.new.fresh")
    monkeypatch.setitem(_moved.NAMES, "house.open.gone", "house.new.value")
    monkeypatch.setitem(_moved.REMOVED, "house.ruin", "the new house")
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == "house"]:
        del sys.modules[name]


def test_every_public_name_of_0_1_imports_from_its_old_place(run_python, old_names, tmp_path):
    assert not any(line.startswith(EXCLUDED) for line in old_names)
    done = run_python("-c", WALK, input="\n".join(old_names))
    assert done.returncode == 0, done.stderr
    failed, tried, warned = json.loads(done.stdout)
    assert failed == []
    assert tried > 700
    assert all(warned[module] for module in _moved.MODULES if module in warned)
    gone = [module for module in warned if importlib.util.find_spec(module).loader is _moved_finder()]
    assert len(gone) > 50
    assert {module: warned[module] for module in gone if len(warned[module]) != 1} == {}


def _moved_finder() -> object:
    (finder,) = (finder for finder in sys.meta_path if type(finder).__module__ == _moved.__name__)
    return finder


def test_the_table_leads_to_modules_that_are_there():
    old = set(_moved.MODULES) | set(_moved.NAMES)
    for new in {*_moved.MODULES.values(), *(name.rpartition(".")[0] for name in _moved.NAMES.values())}:
        assert new not in old
        assert importlib.util.find_spec(new).origin, new


def test_a_module_that_is_gone_warns_once_and_names_the_new_one(moved):
    with pytest.warns(DeprecationWarning, match=r"^house\.old is now house\.new$") as caught:
        old = importlib.import_module("house.old")
    assert len(caught) == 1
    assert isinstance(old, ModuleType)
    assert (old.value, old.aged) == (1, 2)
    assert {"value", "fresh"} <= set(dir(old))
    with pytest.raises(AttributeError, match=r"module 'house\.old' has no attribute 'nothing'"):
        old.nothing  # noqa: B018


def test_a_name_that_left_a_module_warns_once_where_it_is_used(moved):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        house = importlib.import_module("house.open")
        assert (house.kept, house.late) == (3, 4)
    with pytest.warns(DeprecationWarning, match=r"^house\.open\.gone is now house\.new\.value$") as caught:
        assert (house.gone, house.gone) == (1, 1)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    with pytest.raises(AttributeError, match="nothing"):
        house.nothing  # noqa: B018


def test_what_was_not_kept_says_what_there_is_instead(moved):
    with pytest.raises(ModuleNotFoundError, match=r"house\.ruin is gone; instead: the new house"):
        importlib.import_module("house.ruin")
    with pytest.raises(ModuleNotFoundError, match=r"kinreach\.bench is gone; instead: .*benchmarks\.speed"):
        importlib.import_module("kinreach.bench")


def test_nothing_is_loaded_before_an_old_name_is_imported(run_python):
    done = run_python("-W", "error", "-c", "import sys, kinreach; print('\\n'.join(sys.modules))")
    assert done.returncode == 0, done.stderr
    assert not set(done.stdout.split()) & {*_moved.MODULES.values()}

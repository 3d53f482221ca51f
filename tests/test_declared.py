"""What is declared stays: signatures, options of commands, tasks with methods and columns, recipes, arms.

Each is a list in tests/data/declared; what is new needs no line there. `KINREACH_KEEP=1 pytest tests/test_declared.py`
keeps what there is now; its change in git is to be read before it is committed.
"""

import argparse
import importlib
import inspect
import os
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path

import pytest

import kinreach
from kinreach.baselines._recipes.button import BUTTON_RECIPES
from kinreach.baselines._recipes.lift import LIFT_RECIPES
from kinreach.baselines._recipes.reach import REACH_RECIPES
from kinreach.cli import COMMANDS
from kinreach.compare import get_task
from kinreach.compare._task import _OWN
from kinreach.robots import arm_names, get_arm

KEPT = Path(__file__).parent / "data" / "declared"
FACES = sorted(f"kinreach.{each.name}" for each in pkgutil.iter_modules(kinreach.__path__) if each.name[0] != "_")


def said(value):
    """Return a value in words that are the same in every process."""
    if isinstance(value, str | int | float | bool | None | tuple) and not is_dataclass(value):
        return f"({', '.join(map(said, value))})" if isinstance(value, tuple) else repr(value)
    if isinstance(value, partial):
        return f"{said(value.func)}({', '.join(map(said, (*value.args, *value.keywords.items())))})"
    if isinstance(value, Mapping):  # digests of policies change when they are trained anew
        parts = (key if key.startswith("policy ") else f"{key}: {said(each)}" for key, each in value.items())
        return f"{{{', '.join(parts)}}}"
    if isinstance(value, Sequence):
        return f"[{', '.join(map(said, value))}]"
    if is_dataclass(value) and not isinstance(value, type):
        parts = (f"{field.name}={said(getattr(value, field.name))}" for field in fields(value))
        return f"{type(value).__name__}({', '.join(parts)})"
    name = getattr(value, "__qualname__", type(value).__name__).replace(".<locals>", "")
    inside = [said(cell.cell_contents) for cell in getattr(value, "__closure__", None) or ()]
    return f"{name}[{', '.join(inside)}]" if inside and not inspect.isclass(value) else name


def listed(value, name):
    """Yield the entries of nested declarations, each in a line."""
    if is_dataclass(value) and not isinstance(value, type) and name.count(".") < 2:
        for field in fields(value):
            yield from listed(getattr(value, field.name), f"{name}.{field.name}")
    elif isinstance(value, Mapping) and value and name.count(".") < 3:
        for key, each in value.items():
            yield from listed(each, f"{name}.{key}")
    elif isinstance(value, Sequence) and value and is_dataclass(value[0]):
        yield from (f"{name}: {said(each)}" for each in value)
    else:
        yield f"{name}: {said(value)}"


def signatures():
    for face in FACES:
        module = importlib.import_module(face)
        defined = [name for name, each in vars(module).items() if inspect.isclass(each) and issubclass(each, Exception)]
        for name in getattr(module, "__all__", defined):
            value = getattr(module, name)
            own = {name: value} if callable(value) else {}
            if inspect.isclass(value):
                own |= {f"{name}.{key}": each for key, each in vars(value).items() if key[0] != "_" and callable(each)}
            for key, each in own.items():
                try:
                    parameters = inspect.signature(each).parameters.values()
                except (TypeError, ValueError):
                    continue
                shown = (
                    f"{one.kind.name[:1] if one.kind.name[0] == 'K' else ''}{one.name}"
                    + ("" if one.default is one.empty else f"={said(one.default)}")
                    for one in parameters
                )
                yield f"{face}.{key}({', '.join(shown)})"


def commands():
    for name, command in COMMANDS.items():
        parser = importlib.import_module(command.module)._parser(name)
        yield f"{name}: {parser.prog} {parser.formatter_class.__name__} {parser.allow_abbrev}"
        for action in parser._actions:
            if not isinstance(action, argparse._HelpAction):
                parts = (action.nargs, action.const, action.default, action.type, action.choices, action.required)
                flags = " ".join(action.option_strings) or action.dest
                yield f"{name} {flags}: {type(action).__name__} {' '.join(map(said, parts))}"


def tasks():
    for name in _OWN:  # not what other tests register
        yield from listed(get_task(name), name)


def recipes():
    for recipe in (*REACH_RECIPES, *BUTTON_RECIPES, *LIFT_RECIPES):
        yield from listed(recipe, recipe.name)


def arms():
    """Without the shapes of links, which other tests see."""
    for name in arm_names():
        arm = get_arm(name)
        for field in fields(arm):
            if field.name not in ("build_urdf", "notes", "package_root"):
                yield from listed(getattr(arm, field.name), f"{name}.{field.name}")


@pytest.mark.parametrize("declared", [signatures, commands, tasks, recipes, arms])
def test_what_is_declared_stays(declared):
    lines = list(declared())
    assert len(lines) > 40
    path = KEPT / f"{declared.__name__}.txt"
    if os.environ.get("KINREACH_KEEP"):
        path.parent.mkdir(exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    kept = path.read_text(encoding="utf-8").splitlines()
    gone = [line for line in kept if line not in lines]
    assert gone == [], "if it is meant: KINREACH_KEEP=1 pytest tests/test_declared.py"

"""Import objects of the user's modules by name, `module:attribute`."""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from pathlib import Path
from typing import Any

import kinreach
from kinreach._checks import shown
from kinreach.errors import InputError


def load_object(kind: str, path: str) -> Any:
    """Import `module:attribute`; modules in the current folder are found too.

    Args:
        kind: What it should be, for messages.
        path: Its name; importing runs the module.

    Raises:
        InputError: Unknown module or attribute, or the module fails.
    """
    expected = f"{'an' if kind[0] in 'aeiou' else 'a'} {kind} of your own is named module:attribute"
    if not isinstance(path, str):
        raise InputError(f"{expected}, got {shown(path)}")
    module, _, attribute = path.partition(":")
    if module.endswith(".py"):
        name = module.removesuffix(".py").replace("/", ".")
        raise InputError(f"a module is named without .py, as in {name}:{attribute or 'NAME'}; got {path!r}")
    if not module or not attribute:
        raise InputError(f"{expected}, got {path!r}")
    found = load_module(kind, module, path)
    try:
        for name in attribute.split("."):
            found = getattr(found, name)
    except AttributeError as error:
        raise InputError(f"cannot import the {kind} {path}: AttributeError: {error}") from error
    return found


def load_module(kind: str, module: str, path: str) -> Any:
    """Import a module, also one in the current folder.

    Args:
        kind: What should be in it, for messages.
        module: Its name; importing runs it.
        path: How the user named what is in it, for messages.

    Raises:
        InputError: Unknown module, or it fails.
    """
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.append(os.getcwd())
    try:
        return importlib.import_module(module)
    except Exception as error:  # whatever the user's module raises
        raise InputError(f"cannot import the {kind} {path}: {type(error).__name__}: {error}") from error


def place_of(error: Exception) -> str:
    """Return file and line of an error in the user's own code; empty if it is not from there."""
    package = str(Path(kinreach.__file__).parent)
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        frame for frame in frames if "site-packages" not in frame.filename and not frame.filename.startswith(package)
    ]
    return f" ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""

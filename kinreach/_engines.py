"""Imports of the compiled engines, with one clear error when an installation does not fit together.

placo is compiled against one exact Pinocchio; beside another it ends in a missing shared library at import. `load`
turns that into the list of versions to install.
"""

from __future__ import annotations

import importlib
import os
from contextlib import suppress
from functools import cache
from importlib import metadata
from types import ModuleType
from typing import Any

from kinreach.errors import InstallationError

#: The versions that load together with placo.
PLACO_VERSIONS = {
    "placo": "0.10.2",
    "pin": "3.8.0",
    "cmeel-urdfdom": "4.0.1",
    "cmeel-tinyxml2": "10.0.0",
}
#: The environment's variable that names MuJoCo's graphics library.
_GRAPHICS = "MUJOCO_GL"


@cache
def installed_version(distribution: str) -> str | None:
    """Return the version of an installed distribution, else None."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def load(module: str) -> ModuleType:
    """Import a compiled engine (`pinocchio`, `coal`, `placo`).

    Raises:
        InstallationError: The module is missing or its shared libraries do not fit; the message lists
            the versions that are installed, those that are needed, and the command that installs them.
    """
    try:
        return importlib.import_module(module)
    except (ImportError, AttributeError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        said = f"cannot import {module}: {reason}"
        if module != "placo" and installed_version("placo") is None:
            raise InstallationError(
                f"{said}. Found: pin {installed_version('pin') or 'missing'}. Install it again: "
                "pip install --force-reinstall 'pin>=3.8,<5'"
            ) from error
        wrong = [
            f"{name} {installed_version(name) or 'missing'} (needs {wanted})"
            for name, wanted in PLACO_VERSIONS.items()
            if installed_version(name) != wanted
        ]
        found = "; ".join(wrong) if wrong else "all versions as needed, but files of the installation are damaged"
        command = "pip install " + " ".join(f"{name}=={wanted}" for name, wanted in PLACO_VERSIONS.items())
        raise InstallationError(
            f"{said}. Found: {found}. placo loads in one set of versions only; install it: {command}"
        ) from error


def load_extra(module: str, extra: str) -> ModuleType:
    """Import a package that only one of kinreach's extras brings.

    Raises:
        InstallationError: It is missing or does not load; the message names the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InstallationError(
            f"cannot import {module}: {reason}. Install it with: pip install 'kinreach[{extra}]'"
        ) from error


@cache
def load_mujoco() -> Any:
    """Import MuJoCo, with or without its graphics.

    MuJoCo binds the graphics library that `MUJOCO_GL` names at import and fails if that is missing.

    Physics needs no graphics: in that case the import is repeated without. Which library draws is decided when the
    first frame is asked for (`kinreach.sim._rendering`), and only then is a missing one an error.

    Raises:
        InstallationError: It is not installed.
    """
    wanted = os.environ.get(_GRAPHICS)
    if wanted is not None:
        with suppress(Exception):  # MuJoCo lets AttributeError, OSError and RuntimeError of the graphics libraries pass
            return _without_log_file(importlib.import_module("mujoco"))
        os.environ[_GRAPHICS] = "disable"
    try:
        return _without_log_file(importlib.import_module("mujoco"))
    except Exception as error:
        raise InstallationError(f"cannot import mujoco: {error}; install it with: pip install mujoco==4.0.0") from error
    finally:
        if wanted is not None:
            os.environ[_GRAPHICS] = wanted


def _without_log_file(module: Any) -> Any:
    """Keep MuJoCo's warnings out of its default log file; they are still printed to stderr.

    This is a setting of the whole process and of its native threads. A log file that was named before, or is named
    later, is used.
    """
    settings = module.MjLogConfig.get()
    if settings.logfile == "MUJOCO_LOG.TXT":
        settings.logto_file = False
        settings.set()
    return module

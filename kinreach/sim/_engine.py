"""MuJoCo, imported so that a missing graphics library does not stop the physics, and no log file appears."""

from __future__ import annotations

import importlib
import os
from contextlib import suppress
from typing import Any

from kinreach.errors import InstallationError

_GRAPHICS = "MUJOCO_GL"


def _load() -> Any:
    """MuJoCo binds the graphics library that `MUJOCO_GL` names at import and fails if that is missing.

    Physics needs no graphics: in that case the import is repeated without. Which library draws is decided when the
    first frame is asked for (`kinreach.sim._rendering`), and only then is a missing one an error.
    """
    wanted = os.environ.get(_GRAPHICS)
    if wanted is not None:
        with suppress(Exception):  # MuJoCo lets AttributeError, OSError and RuntimeError of the graphics libraries pass
            return importlib.import_module("mujoco")
        os.environ[_GRAPHICS] = "disable"
    try:
        return importlib.import_module("mujoco")
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


mujoco: Any = _without_log_file(_load())

"""MuJoCo, imported so that a missing graphics library does not stop the physics, and no log file appears."""

from __future__ import annotations

import importlib
import os
from typing import Any

from kinreach.errors import InstallationError

_GRAPHICS = "MUJOCO_GL"
#: Where MuJoCo's warnings go if nobody says otherwise: into a file of the folder that the process stands in.
_DEFAULT_LOG = "MUJOCO_LOG.TXT"


def _load() -> Any:
    """MuJoCo binds the graphics library that `MUJOCO_GL` names at import and fails if that is missing.

    Physics needs no graphics: in that case the import is repeated without. Which library draws is decided when the
    first frame is asked for (`kinreach.sim.rendering`), and only then is a missing one an error.
    """
    try:
        return importlib.import_module("mujoco")
    except Exception as error:  # MuJoCo lets AttributeError, OSError and RuntimeError of the graphics libraries pass
        wanted = os.environ.get(_GRAPHICS)
        if wanted is None:
            raise InstallationError(
                f"cannot import mujoco: {error}; install it with: pip install mujoco==4.0.0"
            ) from error
    os.environ[_GRAPHICS] = "disable"
    try:
        return importlib.import_module("mujoco")
    except Exception as error:
        raise InstallationError(f"cannot import mujoco: {error}; install it with: pip install mujoco==4.0.0") from error
    finally:
        os.environ[_GRAPHICS] = wanted


def _without_log_file(module: Any) -> Any:
    """Keep MuJoCo's warnings out of a file that nobody asked for; they are still printed to stderr.

    This is a setting of the whole process and of its native threads. Who has named a log file before keeps it, and who
    names one later gets it.
    """
    settings = module.MjLogConfig.get()
    if settings.logfile == _DEFAULT_LOG:
        settings.logto_file = False
        settings.set()
    return module


mujoco: Any = _without_log_file(_load())

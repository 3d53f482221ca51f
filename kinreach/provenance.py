"""Where numbers come from: versions of everything that made them, the code itself, and the machine."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable
from pathlib import Path

import kinreach
from kinreach.engines import installed_version

DISTRIBUTIONS = ("numpy", "pin", "placo", "mujoco", "qpsolvers", "daqp", "example-robot-data", "opencv-python-headless")


def versions(distributions: Iterable[str] = DISTRIBUTIONS) -> dict[str, str | None]:
    """Versions by distribution name, None for what is not installed; and a digest of kinreach's own source."""
    found = {name: installed_version(name) for name in distributions}
    ours = {"kinreach": kinreach.__version__, "kinreach-source": source_digest()}
    return {"python": platform.python_version(), **ours, **found}


def source_digest() -> str:
    """First 12 hex digits of the SHA-256 over kinreach's modules: tells two states of the code apart."""
    package = Path(kinreach.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


def machine() -> dict[str, str | int | None]:
    """Processor and system that the times were measured on."""
    return {"processor": _processor(), "cores": os.cpu_count(), "system": f"{platform.system()} {platform.machine()}"}


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"

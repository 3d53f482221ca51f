"""Versions of packages and code, and the machine, for the record beside results."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import kinreach
from kinreach._engines import installed_version

DISTRIBUTIONS = ("numpy", "pin", "placo", "mujoco", "qpsolvers", "daqp", "example-robot-data", "opencv-python-headless")


def versions(distributions: Iterable[str] = DISTRIBUTIONS) -> dict[str, str | None]:
    """Return versions by distribution, None for missing ones, and a digest of kinreach's source."""
    found = {name: installed_version(name) for name in distributions}
    ours = {"kinreach": kinreach.__version__, "kinreach-source": source_digest()}
    return {"python": platform.python_version(), **ours, **found}


def digest(*contents: bytes) -> str:
    """Return the first 12 hex digits of the SHA-256 over contents."""
    found = hashlib.sha256()
    for content in contents:
        found.update(content)
    return found.hexdigest()[:12]


def source_digest() -> str:
    """Return the digest over kinreach's modules, which are read once: what runs is what was loaded."""
    return _source_digest(Path(kinreach.__file__).parent)


@cache
def _source_digest(package: Path) -> str:
    paths = sorted(package.rglob("*.py"))
    return digest(*(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() for path in paths))


def machine() -> dict[str, str | int | None]:
    """Return the processor and the system that times are measured on."""
    return {"processor": _processor(), "cores": os.cpu_count(), "system": f"{platform.system()} {platform.machine()}"}


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"

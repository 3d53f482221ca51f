"""Arms by name: those of kinreach, and those of `register_arm`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from kinreach._checks import check_known, shown
from kinreach._objects import load_object
from kinreach.errors import InputError
from kinreach.robots import _arm3 as arm3
from kinreach.robots import _panda as panda
from kinreach.robots import _ur_arms as ur_arms
from kinreach.robots._description import ArmDescription

#: Endings of files that describe an arm.
FILES = (".urdf", ".xml", ".xacro")
#: Arms that are read from a file on first use.
_FROM_FILES: dict[str, Callable[[], ArmDescription]] = {"panda": panda.describe}


@cache
def _arms() -> dict[str, ArmDescription]:
    return {arm.name: arm for arm in (*ur_arms.ARMS, arm3.ARM)}


def register_arm(arm: ArmDescription) -> ArmDescription:
    """Make an arm of your own available by its name, and return it.

    Raises:
        InputError: It is not an `ArmDescription`, or another arm has that name already.
    """
    given: Any = arm
    if not isinstance(given, ArmDescription):
        raise InputError(f"an arm must be an ArmDescription, got {shown(given)}")
    if arm.name in _FROM_FILES or _arms().get(arm.name, arm) is not arm:
        raise InputError(f"an arm named {arm.name!r} is registered already")
    _arms()[arm.name] = arm
    return arm


def get_arm(name: str | ArmDescription) -> ArmDescription:
    """Return the arm with this name, in upper or lower case; a description is returned as it is.

    Raises:
        UnknownNameError: Unknown arm; the message lists the available names.
        InstallationError: The package with its URDF is not installed.
    """
    if isinstance(name, ArmDescription):
        return name
    name = next((known for known in arm_names() if known.lower() == str(name).lower()), name)
    check_known("arm", name, arm_names())
    if name not in _arms():
        _arms()[name] = _FROM_FILES[name]()
    return _arms()[name]


def arm_named(
    text: str,
    *,
    tip: str | None = None,
    joints: Sequence[str] | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> ArmDescription:
    """Return the arm that a command line names: a registered one, a URDF file, or an attribute of a module."""
    if text.lower().endswith(FILES):
        return ArmDescription.from_urdf(text, tip=tip, joints=joints, package_dirs=package_dirs)
    for name, given in (("joints", joints), ("package_dirs", package_dirs)):
        if given:
            raise InputError(f"{name}= is for URDF files, and {shown(text)} is not one")
    if ":" not in text:
        return get_arm(text)
    arm = load_object("arm", text)
    if not isinstance(arm, ArmDescription):
        raise InputError(f"{text} is not an ArmDescription")
    return arm


def arm_names() -> tuple[str, ...]:
    """Return the names of all registered arms, sorted."""
    return tuple(sorted({*_arms(), *_FROM_FILES}))

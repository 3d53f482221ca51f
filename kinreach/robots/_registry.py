"""Arms by name: those of kinreach, and those of `register_arm`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from kinreach._checks import check_known, shown
from kinreach._objects import load_object
from kinreach.errors import InputError
from kinreach.robots import _arm3 as arm3
from kinreach.robots import _panda as panda
from kinreach.robots import _so101 as so101
from kinreach.robots import _ur_arms as ur_arms
from kinreach.robots._description import ArmDescription
from kinreach.robots._urdf import SDF

#: Endings of files that describe an arm.
FILES = (".urdf", ".xml", ".mjcf", ".xacro")
#: What other files are that people have of an arm, by their endings.
_OTHER_FILES = {
    **dict.fromkeys((".sdf", ".world"), SDF),
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), "USD, which is not read: take the URDF that it was made from"),
    **dict.fromkeys((".stl", ".obj", ".dae", ".step", ".stp", ".glb", ".gltf", ".iges"), "a shape, and no arm"),
    **dict.fromkeys((".yaml", ".yml", ".conf"), "a calibration or settings: name its UR, with --calibration FILE"),
    ".srdf": "an SRDF, which says what MoveIt plans with: take the URDF beside it, and give this with --srdf",
    ".py": "a program: name the object in it that describes the arm, as MODULE:ATTRIBUTE",
    **dict.fromkeys((".zip", ".gz", ".tar", ".tgz", ".7z"), "an archive: unpack it"),
    ".urp": "a program of a UR: --calibration FILE takes the robot's calibration from it",
    **dict.fromkeys(
        (".script", ".urscript"), "a program of a UR: kinreach simulate-ur --arm NAME --program FILE runs it"
    ),
    **dict.fromkeys((".json", ".csv", ".txt", ".md", ".png", ".pdf"), "no description of an arm that is read"),
}
#: Arms of kinreach, which are described on first use.
_DESCRIBED: Mapping[str, Callable[[], ArmDescription]] = {**ur_arms.DESCRIBED, "panda": panda.describe}
#: Arms that are described already.
_ARMS = {arm.name: arm for arm in (arm3.ARM, so101.ARM)}


def register_arm(arm: ArmDescription) -> ArmDescription:
    """Make an arm of your own available by its name, and return it.

    Raises:
        InputError: It is not an `ArmDescription`, or another arm has that name already.
    """
    given: Any = arm
    if not isinstance(given, ArmDescription):
        raise InputError(f"an arm must be an ArmDescription, got {shown(given)}")
    if _ARMS.get(arm.name) is not arm and arm.name in arm_names():
        raise InputError(f"an arm named {arm.name!r} is registered already")
    _ARMS[arm.name] = arm
    return arm


def get_arm(name: str | ArmDescription) -> ArmDescription:
    """Return the arm with this name, in upper or lower case; a description is returned as it is.

    Raises:
        UnknownNameError: Unknown arm; the message lists the available names.
        InstallationError: The package with its URDF is not installed.

    Examples:
        >>> from kinreach.robots import get_arm
        >>> arm = get_arm("ur10e").with_tool([0, 0, 0.15, 0, 0, 0])
        >>> arm.joints[0], len(arm.joints)
        ('shoulder_pan_joint', 6)
    """
    if isinstance(name, ArmDescription):
        return name
    name = next((known for known in arm_names() if known.lower() == str(name).lower()), name)
    check_known("arm", name, arm_names())
    return _ARMS[name] if name in _ARMS else _ARMS.setdefault(name, _DESCRIBED[name]())


def arm_named(
    text: str,
    *,
    tip: str | None = None,
    joints: Sequence[str] | None = None,
    held: Mapping[str, float] | None = None,
    package_dirs: Sequence[str | Path] = (),
) -> ArmDescription:
    """Return the arm that a command line names: a registered one, a URDF or MJCF file, or an attribute of a module."""
    if text.lower().endswith(FILES):
        return ArmDescription.from_file(text, tip=tip, joints=joints, held=held, package_dirs=package_dirs)
    if text.lower() not in map(str.lower, arm_names()):
        _refuse_other_files(text)
    for name, given in (("joints", joints), ("held", held), ("package_dirs", package_dirs)):
        if given:
            raise InputError(f"{name}= is for URDF and MJCF files, and {shown(text)} is none")
    if ":" not in text:
        return get_arm(text)
    arm = load_object("arm", text)
    if not isinstance(arm, ArmDescription):
        raise InputError(f"{text} is not an ArmDescription")
    return arm


def _refuse_other_files(text: str) -> None:
    """Refuse what is, or is called like, a file that does not describe an arm."""
    suffix = Path(text).suffix.lower()
    looks = suffix in _OTHER_FILES or os.sep in text or os.path.lexists(text)
    if not looks or (":" in text and suffix not in _OTHER_FILES):
        return
    there = "no file of a kind that is read" if os.path.lexists(text) else "not there"
    what = "a folder" if os.path.isdir(text) else _OTHER_FILES.get(suffix, there)
    raise InputError(
        f"{shown(text)} is {what}; an arm is a URDF or MJCF file ({', '.join(FILES)}), or one of "
        f"{', '.join(arm_names())}"
    )


def arm_names() -> tuple[str, ...]:
    """Return the names of all registered arms, sorted."""
    return tuple(sorted({*_ARMS, *_DESCRIBED}))

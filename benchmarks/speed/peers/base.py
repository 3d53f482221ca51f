"""What all inverse-kinematics peers look like, and what happens to those that are not installed."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from kinreach._checks import Floats
from kinreach.errors import InputError, InstallationError
from kinreach.kinematics._arm import ArmKinematics

T = TypeVar("T")
_AXES = ("JointModelRX", "JointModelRY", "JointModelRZ")


@dataclass(frozen=True)
class IKPeer:
    """Somebody else's inverse kinematics of an arm.

    What a benchmark times is `call` alone: a pose that is already in the peer's own frames and type goes in, and
    whatever it gives comes out.

    Attributes:
        note: How it is called, in a few words.
        prepare: Pose of tool0 in base_link, shape (4, 4) -> what `call` takes.
        call: The peer.
        postures: What `call` gave -> its solutions [rad], shape (k, 6).
        once: The same without restarts, if the peer is one that can be started again.
        batch: Poses, shape (count, 4, 4) -> a call without arguments that solves them all in one, if it has one.
    """

    note: str
    prepare: Callable[[Floats], Any]
    call: Callable[[Any], Any]
    postures: Callable[[Any], Floats]
    once: Callable[[Any], Any] | None = None
    batch: Callable[[Floats], Callable[[], object]] | None = None

    def solve(self, T: Floats) -> Floats:
        """Solutions [rad], shape (k, 6), for a pose of tool0 in base_link, shape (4, 4)."""
        return self.postures(self.call(self.prepare(T)))


def installed(makers: Mapping[str, Callable[[], T]]) -> tuple[dict[str, T], dict[str, str]]:
    """Make what can be made.

    Args:
        makers: Name -> function that imports a peer and sets it up.

    Returns:
        The peers by name, and for each of the others why it is missing.
    """
    made: dict[str, T] = {}
    missing: dict[str, str] = {}
    for name, make in makers.items():
        try:
            made[name] = make()
        except ModuleNotFoundError as error:
            missing[name] = f"not installed (no module {error.name}); pip install 'kinreach[bench]'"
        except InstallationError as error:
            missing[name] = str(error)
        except Exception as error:  # whatever an incompatible version raises
            missing[name] = f"does not start: {type(error).__name__}: {error}"
    return made, missing


def coordinate_axis(kin: ArmKinematics, joint: int) -> int:
    """Which axis of its own frame a joint of the arm turns about: 0, 1 or 2.

    Raises:
        InputError: It is none of the three.
    """
    kind = kin.model.joints[joint + 1].shortname()
    if kind not in _AXES:
        raise InputError(f"joint type {kind} does not turn about x, y or z")
    return _AXES.index(kind)


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Swallow what compiled code prints on the standard streams (ur-analytic-ik warns once per rejected branch)."""
    kept = [os.dup(1), os.dup(2)]
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 1)
        os.dup2(null, 2)
        yield
    finally:
        os.dup2(kept[0], 1)
        os.dup2(kept[1], 2)
        for descriptor in (*kept, null):
            os.close(descriptor)

"""Where the joints of an arm are in MuJoCo's arrays, and those that follow them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.robots import ArmDescription
from kinreach.robots.inside import followers
from kinreach.sim._plants import rows_and_columns


def as_index(addresses: Sequence[int]) -> slice | NDArray[np.intp]:
    """Return where the joints are in one of MuJoCo's arrays; a slice (a view, and faster) if they lie side by side."""
    index = np.array(addresses, dtype=np.intp)
    if (np.diff(index) == 1).all():
        return slice(int(index[0]), int(index[-1]) + 1)
    return index


class ArmJoints:
    """The joints of an arm in a scene.

    MuJoCo has a number for a joint that follows another, too, and a constraint that brings it where the other has it.

    Attributes:
        qpos, dof: Where the arm's joints are in MuJoCo's `qpos` and `qvel`, without those that follow them.
    """

    def __init__(self, arm: ArmDescription, model: Any) -> None:
        joints = [model.joint(name) for name in arm.joints]
        self.qpos = as_index([joint.qposadr[0] for joint in joints])
        self.dof = as_index([joint.dofadr[0] for joint in joints])
        follow = followers(arm)
        self._any = bool(follow)
        self._leader = np.array([arm.joints.index(how.joint) for how in follow.values()], dtype=np.intp)
        self._factor = np.array([how.factor for how in follow.values()])
        self._offset = np.array([how.offset for how in follow.values()])
        self._their_qpos = np.array([model.joint(name).qposadr[0] for name in follow], dtype=np.intp)
        self._their_dof = np.array([model.joint(name).dofadr[0] for name in follow], dtype=np.intp)

    def put(self, qpos: Floats, rows: Any, q: Floats) -> None:
        """Write postures into some rows of MuJoCo's `qpos`, shape (count, nq).

        Args:
            qpos: MuJoCo's array, live.
            rows: A slice, or k integers.
            q: Postures [rad, m], shape (k, n), or (n,) for the same in all.
        """
        qpos[rows_and_columns(rows, self.qpos)] = q
        if self._any:
            qpos[rows_and_columns(rows, self._their_qpos)] = q[..., self._leader] * self._factor + self._offset

    def spread(self, change: Floats, full: Floats) -> None:
        """Write a change of the arm's joints, shape (n,), into that of everything, shape (nv,)."""
        full[self.dof] = change
        if self._any:
            full[self._their_dof] = change[self._leader] * self._factor

    def gathered(self, full: Floats) -> Floats:
        """Return what forces on everything, shape (nv,), are to the arm's joints, shape (n,)."""
        own: Floats = full[self.dof].copy()
        if self._any:
            np.add.at(own, self._leader, full[self._their_dof] * self._factor)
        return own

"""Solvers of the table. Another one is a class like these, named on the command line as `module:Class`."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from benchmarks.ik_arms.arms import SEVEN, class_of, parameters
from benchmarks.speed.peers.analytic import FLIP, eaik_of
from kinreach._checks import Floats
from kinreach._rotations import pose_error
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics


class Solver(Protocol):
    """Every posture of a pose.

    A solver may also have `batch(T)` for poses (m, 4, 4); it is only timed. Joint limits are ignored.

    Args:
        kin: The arm: `kin.fk`, `kin.arm.urdf`, `kin.chain.placements`. It raises what it likes to refuse an arm; the
            message is printed.
    """

    name: str

    def __init__(self, kin: ArmKinematics) -> None: ...

    def all(self, T: Floats) -> Floats:
        """Postures [rad], shape (k, n), for a pose of the tip, shape (4, 4); of a curve, postures 0.15 rad apart."""
        ...


class Kinreach:
    """kinreach's own closed form, or its curves for seven axes."""

    name = "kinreach"

    def __init__(self, kin: ArmKinematics) -> None:
        self._kin: Any = ArmKinematics.of(kin.arm, tip=kin.tip)
        self._curves = hasattr(self._kin, "self_motions")
        if not self._curves and not hasattr(self._kin, "all_solutions"):
            raise InputError(f"no method for every posture of {kin.n} joints")
        if not self._curves:
            self.batch: Callable[[Floats], object] = lambda T: self._kin.batch(T, limits=False)

    def all(self, T: Floats) -> Floats:
        """As in `Solver`."""
        if not self._curves:
            return np.asarray(self._kin.all_solutions(T, limits=False).q)
        return np.vstack([np.empty((0, 7)), *(curve.q for curve in self._kin.self_motions(T, limits=False))])


class SSIK:
    """The arms that ssik ships, prepared."""

    name = "ssik"

    def __init__(self, kin: ArmKinematics) -> None:
        import ssik

        self._arm, self._n = ssik.Manipulator.from_prebuilt(kin.arm.name), kin.n

    def all(self, T: Floats) -> Floats:
        """As in `Solver`."""
        found = self._arm.solve(T, respect_limits=False, enumerate_windings=False)
        return np.array([solution.q for solution in found]).reshape(-1, self._n)


class EAIK:
    """EAIK (Ostermeier et al.), without the answers that it calls approximate."""

    name = "EAIK"

    def __init__(self, kin: ArmKinematics) -> None:
        _six(kin)
        self._peer = eaik_of(kin)
        self.all = self._peer.solve

    def batch(self, T: Floats) -> object:
        """Answers for poses (m, 4, 4)."""
        assert self._peer.batch is not None
        return self._peer.batch(T)()


class RoboticsToolbox:
    """roboticstoolbox's symbolic derivation (version 1.5)."""

    name = "roboticstoolbox"

    def __init__(self, kin: ArmKinematics) -> None:
        _six(kin)
        from roboticstoolbox import DHRobot, RevoluteDH

        self._dh = dh = parameters(kin)
        lengths = zip(dh.d, [*dh.a, 0.0], [*dh.alpha, 0.0], strict=True)
        self._solver = DHRobot([RevoluteDH(d=d, a=a, alpha=alpha) for d, a, alpha in lengths]).analytic_ik()
        self._before, self._after = np.linalg.inv(dh.before), np.linalg.inv(dh.after)

    def all(self, T: Floats) -> Floats:
        """As in `Solver`."""
        found = self._solver.solve(self._before @ T @ self._after)
        q = np.asarray(found.q, dtype=np.float64).reshape(-1, 6) if found.success else np.empty((0, 6))
        return (q - self._dh.offset) * self._dh.sign


class URAnalytic:
    """ur-analytic-ik: the data sheets of UR."""

    name = "ur-analytic-ik"

    def __init__(self, kin: ArmKinematics) -> None:
        import ur_analytic_ik

        self._model: Any = getattr(ur_analytic_ik, kin.arm.name.removesuffix("_ik"), None)
        if self._model is None:
            raise InputError("UR models by their data sheets only")
        self._tool = np.linalg.inv(FLIP @ kin.fk(np.zeros(6))) @ self._model.forward_kinematics(*np.zeros(6))
        q = np.arange(6.0)
        if max(pose_error(FLIP @ kin.fk(q) @ self._tool, self._model.forward_kinematics(*q))) > 1e-6:
            raise InputError("its lengths of this model differ")

    def all(self, T: Floats) -> Floats:
        """As in `Solver`."""
        return np.array(self._model.inverse_kinematics(FLIP @ T @ self._tool)).reshape(-1, 6)


class TracIK:
    """TRAC-IK (Beeson and Ames) by pytracik: an iterative solver, which returns one posture; the seed is zero."""

    name = "TRAC-IK"

    def __init__(self, kin: ArmKinematics) -> None:
        from trac_ik import TracIK as Wrapped

        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "arm.urdf"
            file.write_text(kin.arm.urdf, encoding="utf-8")
            self._solver = Wrapped(kin.arm.base, kin.arm.tips[kin.tip], str(file), timeout=0.02, epsilon=1e-7)
        self._seed = np.zeros(kin.n)

    def all(self, T: Floats) -> Floats:
        """As in `Solver`."""
        q = self._solver.ik(T[:3, 3].copy(), T[:3, :3].copy(), self._seed)
        return np.empty((0, len(self._seed))) if q is None else np.atleast_2d(q)


SOLVERS: dict[str, type[Solver]] = {
    kind.name: kind for kind in (Kinreach, SSIK, EAIK, RoboticsToolbox, URAnalytic, TracIK)
}


def solver_class(path: str) -> type[Solver]:
    """A class by `module:Class`.

    Raises:
        InputError: There is none, or it is not a solver.
    """
    module, _, name = path.partition(":")
    try:
        found: Any = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"--solver must be module:Class, got {path!r}: {error}") from None
    if not isinstance(getattr(found, "name", None), str) or not hasattr(found, "all"):
        raise InputError(f"--solver {path}: the class needs a `name` and a method `all(T)`")
    kind: type[Solver] = found
    return kind


def _six(kin: ArmKinematics) -> None:
    if class_of(kin) == SEVEN:
        raise InputError("six joints only")

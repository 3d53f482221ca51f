"""The tip error of a calibrated UR in postures that are solved by its data sheet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import rotation_angle
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, ClosedFormKinematics, IKResult, URKinematics
from kinreach.robots import ArmDescription

#: Cells of a map along its longer edge.
CELLS = 32
#: Half the edge of the map of an arm without a table, relative to the stretched arm.
AROUND = 0.9


@dataclass(frozen=True, eq=False)
class TipMiss:
    """A posture that is solved by the data sheet, on the real arm.

    Attributes:
        meant: Frame of the tip by the data sheet, shape (4, 4).
        real: Frame of the tip of the real arm, shape (4, 4).
    """

    q: Floats
    meant: Floats
    real: Floats

    @property
    def vector(self) -> Floats:
        """From the tip by the data sheet to the real one, in the world [m], shape (3,)."""
        return self.real[:3, 3] - self.meant[:3, 3]

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.vector))

    @property
    def turned(self) -> float:
        """Angle between the two frames [rad]."""
        return rotation_angle(self.meant[:3, :3], self.real[:3, :3])


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """Tip errors on a horizontal rectangle, with the tool pointing down.

    Attributes:
        centre: Of the rectangle in the world [m], shape (3,).
        size: Edges along x and y [m].
        distances: Tip error of each cell [m], shape (rows, columns), rows along y and columns along x; NaN where the
            data sheet's arm has no posture.
    """

    centre: Floats
    size: tuple[float, float]
    distances: Floats

    @property
    def known(self) -> Floats:
        """The errors that are not NaN [m], shape (k,)."""
        return self.distances[np.isfinite(self.distances)]


class RealArm:
    """Kinematics of a UR by its data sheet and by its calibration, from the world to the arm's own tip."""

    def __init__(self, nominal: ArmDescription, real: ArmDescription) -> None:
        arms = [ArmKinematics.of(arm, base="world") for arm in (nominal, real)]
        for arm in arms:
            if not isinstance(arm, URKinematics):
                raise InputError(f"only a UR has a factory calibration, got the arm {nominal.name!r}")
        self.nominal: URKinematics = arms[0]  # type: ignore[assignment]
        self.real: ClosedFormKinematics = arms[1]  # type: ignore[assignment]

    def miss(self, q: Floats) -> TipMiss:
        """Compare the tip with that of the data sheet in a posture [rad], shape (6,)."""
        return TipMiss(q, self.nominal.fk(q), self.real.fk(q))

    def believed(self, T: Floats, seed: Floats) -> IKResult:
        """Solve for a frame (4, 4) in the world by the data sheet: the posture nearest to a seed [rad], shape (6,)."""
        return self.nominal.nearest(T, seed)

    def map(self) -> ErrorMap:
        """Map the tip error over the table, or over the floor around an arm without one."""
        centre, size = _surface(self.nominal)
        cell = max(size) / CELLS
        columns, rows = (max(1, round(edge / cell)) for edge in size)
        x = centre[0] + size[0] * ((np.arange(columns) + 0.5) / columns - 0.5)
        y = centre[1] + size[1] * ((np.arange(rows) + 0.5) / rows - 0.5)
        points = np.stack([*np.meshgrid(x, y), np.full((rows, columns), centre[2])], axis=-1)
        seed = np.array(self.nominal.arm.home)
        distances = np.array([[self._distance(point, seed) for point in row] for row in points])
        return ErrorMap(centre, size, distances)

    def _distance(self, position: Floats, seed: Floats) -> float:
        result = self.nominal.axis_goal(position, (0.0, 0.0, -1.0), seed)
        return self.miss(result.q).distance if result.success else np.nan


def colours(values: Floats, most: float) -> NDArray[np.uint8]:
    """Viridis from 0 to `most` as RGBA, shape (..., 4); transparent for NaN."""
    return colormaps["viridis"](values / most, bytes=True)


def _surface(kinematics: URKinematics) -> tuple[Floats, tuple[float, float]]:
    """Centre and edges of a map: of the table, else around the arm."""
    for box in kinematics.arm.workcell.obstacles:
        if box.name == "table":
            x, y, z = box.position
            return np.array([x, y, z + box.size[2] / 2]), (box.size[0], box.size[1])
    edge = 2 * AROUND * kinematics.geometry.stretched
    return np.array(kinematics.T_world_base[:3, 3]), (edge, edge)

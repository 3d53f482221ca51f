"""Kinematics of palletizers, whose rods keep the tool upright, in closed form."""

from __future__ import annotations

import numpy as np

from kinreach._checks import Floats
from kinreach._rotations import turn, wrapped
from kinreach.errors import InputError
from kinreach.kinematics._by_geometry import NOWHERE, SINGULAR, ByGeometry, Found, elbow_bend, how_far

#: How far axes may be from parallel, or from square, by the sine of their angle: URDFs write 1.5708. Newton's method
#: makes up for it.
PARALLEL = 2e-5
#: By how much more a goal that is just reached may seem out of reach for it [m].
NEARLY = 2e-3
#: The bend of an elbow from which Newton's method begins there [rad].
BEND = 0.02
#: A link that is none, for the same reason [m].
SHORT = 1e-6
#: How far the multipliers of joints that follow others may be from whole numbers.
WHOLE = 1e-9


class PalletizerKinematics(ByGeometry):
    r"""Kinematics of a palletizer, such as an ABB IRB 460 or a Dobot Magician. Threads may share an instance.

    Its first joint turns about an axis, its last one about another that is parallel to it. Between these are parallel
    axes across, which are moved by two joints of `q` and by others that follow these, so that the orientation behind
    them does not change. With complex numbers for the plane across these axes, the wrist is at

    .. math:: w = c + l_1 e^{i \alpha} + l_2 e^{i \beta}

    and :math:`\alpha` and :math:`\beta` are sums of the two joints, with multipliers -1, 0 and 1. Postures are up to
    four: to the front or over the back, with the elbow on either side. They miss their pose by less than 1e-9 m
    and rad. Where a pose is singular, a joint that is free keeps the seed's value, or is at 0.

    A pose has postures only if its orientation is one that the arm can have. For a `PositionGoal` the last joint keeps
    the seed's value.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: As in `ArmKinematics`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm is another.
    """

    joints, branches = 4, 4
    _steps, _near = 10, 2.0 * NEARLY

    def _prepare(self) -> None:
        moves = self.moves
        entries = [each.entry for each in moves]
        middle = moves[1:-1]
        fits = self.n == 4 and not self.slides.any() and len(moves) > 4
        fits = fits and entries[0] == 0 and entries[-1] == 3 and {*entries[1:-1]} == {1, 2}
        if not fits:
            raise self._other("first and last joint turn alone, and rods keep what is between them upright")
        self._still = self.chain.fk(np.zeros((1, 4)))[0]
        frames = [self.chain.placements[0]]
        for placement in self.chain.placements[1:]:
            frames.append(frames[-1] @ placement)
        first, *across, last, tip = frames
        a, b = first[:3, 2], across[0][:3, 2]
        if abs(a @ b) > PARALLEL or max(np.linalg.norm(np.cross(b, each[:3, 2])) for each in across) > PARALLEL:
            raise self._other("axes 2 to those of the rods are parallel, and across the first")
        self._axis, self._out, self._across, self._last_turning = a, np.cross(a, b), b, 3
        angles = np.zeros(3)  # by how much the frame behind a joint is turned: by each of joints 2 and 3, and at 0
        links: dict[tuple[float, float], complex] = {(0.0, 0.0): self._plane(across[0][:3, 3] - first[:3, 3])}
        for here, then, move in zip(across, [*across[1:], last], middle, strict=True):
            sign = 1.0 if here[:3, 2] @ b > 0.0 else -1.0
            angles += sign * np.array([*(move.factor * (move.entry == each) for each in (1, 2)), move.offset])
            way = self._plane(then[:3, 3] - here[:3, 3]) * np.exp(1j * angles[2])
            by = (round(float(angles[0]), 9), round(float(angles[1]), 9))
            links[by] = links.get(by, 0j) + way
        if abs(angles[:2]).max() > WHOLE:
            raise self._other("its rods keep the last axis parallel to the first")
        still = turn(b, float(angles[2]))
        axis = still @ last[:3, 2]
        if np.linalg.norm(np.cross(a, axis)) > PARALLEL:
            raise self._other("the last axis is parallel to the first")
        self._sense = 1.0 if a @ axis > 0.0 else -1.0
        self._shoulder, self._base = links.pop((0.0, 0.0)), first[:3, 3]
        links = {by: link for by, link in links.items() if abs(link) > SHORT}
        sums = np.array(list(links), dtype=np.float64)
        if len(links) != 2 or np.abs(sums - np.rint(sums)).max() > WHOLE or abs(abs(np.linalg.det(sums)) - 1.0) > WHOLE:
            raise self._other("it has two links, with multipliers of -1 or 1")
        self._links, self._to_joints = tuple(links.values()), np.linalg.inv(np.rint(sums))
        self._beside = float(b @ (last[:3, 3] - first[:3, 3]))
        self._hand = still @ (tip[:3, 3] - last[:3, 3])

    def _other(self, needed: str) -> InputError:
        return InputError(
            f"arm {self.arm.name!r}: of arms in which joints follow others, palletizers of four axes have a closed "
            f"form: {needed}"
        )

    def _plane(self, way: Floats) -> complex:
        """A way in the plane across the parallel axes, as a complex number: out, and along the first axis."""
        return complex(self._out @ way, self._axis @ way)

    def _find(self, T: Floats, near: Floats, *, hold: bool = False) -> Found:
        """Postures of a pose; with `hold` of its point, and the last joint keeps its value."""
        heading = self._heading(T)
        shoulder, beside, way = self._shoulder, self._beside, T[:3, 3] - self._base
        if hold:  # the hand is as if it were a part of the forearm
            hand = turn(self._axis, self._sense * float(near[3])) @ self._hand
            shoulder, beside = shoulder + self._plane(hand), beside + float(self._across @ hand)
        else:
            way = way - turn(self._axis, heading) @ self._hand
        around = complex(self._out @ way, -self._across @ way)  # about the first axis
        close, free = abs(beside) - abs(around), abs(around) < NOWHERE
        too_close = (
            f"the goal is {close:.3g} m too close to the axis of {self.arm.joints[0]}" if close > NOWHERE else ""
        )
        if close > NEARLY:
            return Found([], [], [], too_close)
        out = float(np.sqrt(max(abs(around) ** 2 - beside**2, 0.0)))
        found, reasons = Found([], [], []), []
        for back, x in enumerate((out,) if out < NOWHERE else (out, -out)):
            first = float(near[0]) if free else float(np.angle(around / complex(x, -beside)))
            bends, reason = self._bends(complex(x, self._axis @ way) - shoulder)
            reasons.append(reason)
            for elbow, (sums, straight) in enumerate(bends):
                last = float(near[3]) if hold else self._sense * (heading - first)
                found.q.append(wrapped(np.array([first, *(self._to_joints @ sums), last])))
                found.branch.append(2 * back + elbow)
                found.flags.append(SINGULAR if free or straight else 0)
        return found._replace(reason=too_close or min(reasons, key=len))

    def _bends(self, way: complex) -> tuple[list[tuple[Floats, bool]], str]:
        """Both alpha and beta with which the links go a way, and whether the elbow is straight there; or why none."""
        upper, fore = self._links
        bend, far, close = elbow_bend(upper, fore, way)
        what = how_far(far, close)
        reason = f"the wrist would be {what} the axis of {self.arm.joints[1]}" if what else ""
        if max(far, close) > NEARLY:
            return [], reason
        straight = bend in (0.0, np.pi) and not reason
        if reason:  # just out of reach but for what axes are off: Newton's method needs a bend to begin with
            bend = BEND if bend < BEND else np.pi - BEND
        found = []
        for angle in (bend,) if straight else (bend, -bend):
            between = angle + float(np.angle(upper) - np.angle(fore))
            alpha = float(np.angle(way) - np.angle(upper + fore * np.exp(1j * between)))
            found.append((np.array([alpha, alpha + between]), straight))
        return found, reason

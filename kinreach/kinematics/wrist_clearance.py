"""Whether wrist and gripper touch the work cell, the base or the shoulder, for many postures at once.

Two steps. First a short program over all postures: exactly how low the finger tips are, and whether anything else may
be below the table top or near the arm's foot. That decides most postures, and the common contact, finger tips on the
table, exactly. In the rest every body near a box is tested against it by separating axes.

Everything is first computed where q0 is 0, for the first joint only turns the arm about the vertical.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from kinreach.kinematics.bodies import RoundedBox, Single, enclosing, fitted, overlap
from kinreach.kinematics.chain import Entry, Frame, SerialChain, minus, plus, times
from kinreach.kinematics.collision import CollisionChecker, Shape

Flags = NDArray[np.bool_]

#: The joint from which on links are judged here: wrist_2.
FIRST_JOINT = 4


class WristClearance:
    """Wrist and gripper against what stands still or turns with the first joint.

    Args:
        chain: The arm, in the world frame; its first axis is the world's z axis.
        checker: Where the shapes are from. Those of the fingers, equal and side by side, are the last of the arm's.
        table: Name of the obstacle in front of the arm; all others are below its top or are part of the foot.
        foot: Names of the obstacles under and around the base.
    """

    def __init__(self, chain: SerialChain, checker: CollisionChecker, *, table: str, foot: Collection[str]) -> None:
        def bodies_of(choose: Callable[[Shape], bool]) -> list[RoundedBox]:
            shapes = zip(checker.shapes, checker.geometry.geometryObjects, strict=True)
            return [body for shape, solid in shapes if choose(shape) for body in fitted(shape.name, shape.joint, solid)]

        bodies = bodies_of(lambda shape: shape.joint >= FIRST_JOINT)
        (table_top,) = bodies_of(lambda shape: shape.name == table)
        ground = bodies_of(lambda shape: shape.obstacle and shape.name not in (*foot, table))
        below = bodies_of(lambda shape: shape.name in foot)
        base = bodies_of(lambda shape: shape.joint == -1 and not shape.obstacle)
        shoulder = bodies_of(lambda shape: shape.joint == 0)
        self._chain, self._bodies = chain, bodies
        self._table = table_top
        turning = [_where_q0_is_0(chain, body) for body in shoulder]
        self._foot = enclosing([*below, *base, *map(_swept, turning)])
        self._floor = max(box.top for box in ground)
        self._joints = sorted({body.joint for body in bodies})
        self._level = np.array([self._joints.index(body.joint) for body in bodies])
        self._centre = np.array([body.centre for body in bodies], dtype=np.float32)
        self._balls = [_ball([body for body in bodies if body.joint == joint]) for joint in self._joints]
        hand = [body for body in bodies if body.joint == self._joints[-1]]
        self._palm, self._fingers = enclosing(hand[:-2]), enclosing(hand[-2:])
        self._finger_ends = _end(self._fingers)
        boxes = [table_top, *ground, *below, *base, *turning]
        self._fixed, self._obstacles = len(boxes) - len(turning), len(boxes) - len(turning) - len(base)
        self._turns = (np.arange(len(boxes)) >= self._fixed).astype(np.intp)
        self._box_centre = np.array([box.centre for box in boxes], dtype=np.float32)[:, None, :, None]
        # how near centres are where a body and a box may touch: box, body, coordinate
        reach = [[box.half + box.radius + body.reach for body in bodies] for box in boxes]
        self._reach = np.array(reach, dtype=np.float32)[..., None]
        # all there is to know of a body and a box, in a column for each pair
        pairs = [
            [*body.half, body.radius, *body.centre, *(box.half + box.radius), *box.centre]
            for box in boxes
            for body in bodies
        ]
        self._pairs = np.array(pairs, dtype=np.float32).T.copy()

    def touches(self, q: Single) -> tuple[Flags, Flags]:
        """Which postures touch the work cell, and which the base or the shoulder.

        Args:
            q: Postures [rad], shape (6, m).
        """
        on_table, unclear = self._screened(q)
        on_arm = np.zeros(q.shape[1], dtype=np.bool_)
        rows = np.flatnonzero(unclear)
        if len(rows):
            on_table[rows], on_arm[rows] = self._examined(q.take(rows, axis=1))
        return on_table, on_arm

    def _screened(self, q: Single) -> tuple[Flags, Flags]:
        """Whether the gripper is in the table for certain; whether that, or something else, has to be looked at."""
        c, s = np.cos(q[0]), np.sin(q[0])
        table, end = self._table, self._finger_ends
        low, near = [], []
        frames = self._chain.frames([0.0, *q[1:]], self._joints, single=True)
        for frame, (centre, radius) in zip(frames, self._balls, strict=True):
            x, y, z = frame.point(centre)
            x, y = _turned(x, y, c, s)
            if frame is frames[-1]:
                upright = [abs(axis[2]) for axis in frame[:3]]
                low.append(np.minimum(_bottom(frame, upright, self._fingers), _bottom(frame, upright, self._palm)))
            else:
                low.append(z - radius)
            near += [(low[-1] < box.top) & _above(box, x, y, radius) for box in (self._foot, table)]
        near.append(reduce(np.minimum, low) < self._floor)
        # x, y, z: the centre of the hand. From there to the ends of the fingers it is in one piece.
        hand = frames[-1]
        on_table = (_bottom(hand, upright, end) < table.top) & (z > table.bottom) & _above(table, x, y, -end.reach)
        x, y, _ = hand.point(end.centre.tolist())
        on_table &= _above(table, *_turned(x, y, c, s), -end.reach)
        return on_table, reduce(np.logical_or, near) & ~on_table

    def _examined(self, q: Single) -> tuple[Flags, Flags]:
        """The same as `touches`, by separating axes."""
        count = q.shape[1]
        # where q0 is 0: joint; three axes and the origin; coordinate; posture
        frames = np.empty((len(self._joints), 4, 3, count), dtype=np.float32)
        for place, frame in zip(frames, self._chain.frames([0.0, *q[1:]], self._joints, single=True), strict=True):
            for vector, coordinates in zip(place, frame, strict=True):
                for row, coordinate in zip(vector, coordinates, strict=True):
                    row[:] = coordinate
        pair, posture = np.divmod(np.flatnonzero(self._near(frames, q[0])), count)
        box, body = np.divmod(pair, len(self._bodies))
        entries = 12 * count * self._level[body] + posture + count * np.arange(12)[:, None]
        own = frames.ravel().take(entries).reshape(4, 3, -1)
        _turn(own, np.where(box < self._fixed, q[0].take(posture), np.float32(0.0)))
        half, radius, centre, box_half, box_centre = np.split(self._pairs.take(pair, axis=1), (3, 4, 7, 10))
        axes, origin = own[:3], own[3]
        offset = origin + (axes * centre[:, None]).sum(axis=0) - box_centre
        met = np.flatnonzero(overlap(axes, half, radius[0], offset, box_half))
        found = np.zeros((2, count), dtype=np.bool_)
        found[(box[met] >= self._obstacles).astype(np.intp), posture[met]] = True
        return found[0], found[1]

    def _near(self, frames: Single, q0: Single) -> Flags:
        """Where a body is so near to a box that they may touch, shape (boxes, bodies, m)."""
        own = frames[self._level]
        centres = np.empty((2, *own[:, 3].shape), dtype=np.float32)  # in the world, and where q0 is 0
        turned, still = centres
        still[:] = own[:, 3]
        for axis in range(3):
            still += own[:, axis] * self._centre[:, axis, None, None]
        turned[:] = still
        _turn(turned, q0)
        gap = centres[self._turns]
        gap -= self._box_centre
        x, y, z = (np.abs(gap, out=gap) < self._reach).transpose(2, 0, 1, 3)
        near: Flags = x & y & z
        return near


def _turn(vectors: Single, angle: Single) -> None:
    """Turn vectors about the vertical, in place: any number of them, shape (k, 3, m), by m angles [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors[:, 0].copy(), vectors[:, 1]
    vectors[:, 0] = c * x - s * y
    vectors[:, 1] = s * x + c * y


def _where_q0_is_0(chain: SerialChain, body: RoundedBox) -> RoundedBox:
    """A body of the first link, in the world."""
    (frame,) = chain.frames([0.0] * chain.joints, [0])
    R, centre = np.array(frame[:3], dtype=np.float64).T, np.array(frame.point(body.centre.tolist()), dtype=np.float64)
    return RoundedBox(body.name, -1, centre, np.abs(R) @ body.half, body.radius)


def _ball(bodies: Sequence[RoundedBox]) -> tuple[list[float], float]:
    """Centre [m], with as few coordinates as possible, and radius [m] of a ball around bodies of one joint."""
    centre = enclosing(bodies).centre
    centre = np.where(np.abs(centre) < 0.1 * np.abs(centre).max(), 0.0, centre)
    return centre.tolist(), max(float(np.linalg.norm(body.centre - centre)) + body.reach for body in bodies)


def _swept(body: RoundedBox) -> RoundedBox:
    """A box around everything that a body reaches when it turns about the vertical."""
    across = float(np.linalg.norm(np.abs(body.centre[:2]) + body.half[:2])) + body.radius
    half = np.array([across, across, body.half[2] + body.radius])
    return RoundedBox(body.name, body.joint, body.centre * (0.0, 0.0, 1.0), half, 0.0)


def _end(box: RoundedBox) -> RoundedBox:
    """The face of a box that is farthest from its joint."""
    axis = int(np.argmax(np.abs(box.centre)))
    face, half = box.centre.copy(), box.half.copy()
    face[axis] += np.copysign(half[axis], face[axis])
    half[axis] = 0.0
    return RoundedBox(box.name, box.joint, face, half, 0.0)


def _bottom(frame: Frame, upright: Sequence[Entry], box: RoundedBox) -> Entry:
    """Height of the lowest point of a box with sharp edges [m]; `upright` says how steep the frame's axes are."""
    z = frame.height(box.centre.tolist())
    for steepness, half in zip(upright, box.half.tolist(), strict=True):
        z = minus(z, times(steepness, half))
    return z


def _turned(x: Entry, y: Entry, c: Single, s: Single) -> tuple[Entry, Entry]:
    """A point turned about the vertical by the angles with these cosines and sines."""
    return minus(times(c, x), times(s, y)), plus(times(s, x), times(c, y))


def _above(box: RoundedBox, x: Entry, y: Entry, slack: float) -> Flags:
    """Whether a point is over a box that is wider by `slack` [m]."""
    inside = [
        abs(minus(value, float(box.centre[axis]))) < float(box.half[axis] + slack) for axis, value in enumerate((x, y))
    ]
    return inside[0] & inside[1]

"""The self-motion of a seven-axis arm: all postures of a pose, as curves in joint space.

One joint is held at values all around its circle; the six-axis arm that is left has finitely many postures for each,
by closed form or elimination (`method_of`). From all of them at once the curves are followed by a tangent and Newton's
method (Burdick, On the inverse kinematics of redundant manipulators: characterization of the self-motion manifolds,
ICRA 1989), each up to the next held value or back to its own, where the curve turns. A closed curve may lie wholly
between two of the values. Such curves are looked for from postures that only just do not exist, where the six-axis arm
has a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics._angles import TURN, wrapped
from kinreach.kinematics._chain import SerialChain
from kinreach.kinematics._general_6r import miss, turns_about_z
from kinreach.kinematics._six_axis.methods import Method, method_of

JOINTS = 7
#: Values at which a joint is held: with a closed form for the other six, and with elimination.
VALUES, FEWER_VALUES = 72, 48
#: By how much finer they are where nothing is found.
FINER = 8
#: By how much a pose may be missed at a held value if a curve lies between that and the next [m, rad].
AMISS = 0.03
#: Longest and shortest step along a curve [rad].
LONGEST, SHORTEST = 0.1, 1e-4
#: Most steps up to the next value.
MAX_STEPS = 400
#: A posture is on a curve if it misses the pose by less [m, rad]; steps of Newton's method to get there.
ON_CURVE, NEWTON = 1e-11, 4
#: Two postures nearer than this are one [rad].
SAME = 1e-5
#: Cosine between the tangents at both ends of a step.
STRAIGHT = 0.97
#: What is added to a matrix before it is inverted.
NUDGE = 1e-14


@dataclass
class _Node:
    """A posture with the held joint at one of the values, and the pieces of the curve that leave it.

    Attributes:
        q: Posture [rad], shape (7,).
        value: Index of the held joint's value.
        links: By direction in which the held joint moves, 1 or -1: the node where the piece ends, the direction in
            which it would leave that node backwards along the piece, and postures from here to there.
    """

    q: Floats
    value: int
    links: dict[int, tuple[int, int, Floats]] = field(default_factory=dict)


class _Sweep:
    """A joint that is held, and how the six others are solved.

    Args:
        held: Index of the joint, the first or the last.
        placements: Of the whole arm, as in `Chain`.
        method: How the six others are solved.
    """

    def __init__(self, held: int, placements: Floats, method: Method) -> None:
        self.held, self.method, self._placements = held, method, placements

    def values(self, fineness: int) -> Floats:
        """Values of the held joint [rad]."""
        count = fineness * (VALUES if self.method.rank else FEWER_VALUES)
        return np.asarray(TURN * (np.arange(count) + 0.382) / count - np.pi)

    def poses(self, values: Floats, T: Floats) -> Floats:
        """Poses of the six-axis arm for values of the held joint, shape (m, 4, 4)."""
        turns, A = turns_about_z(values), self._placements
        if self.held == 0:
            return np.asarray(np.linalg.inv(A[0] @ turns) @ T)
        return np.asarray(T @ np.linalg.inv(turns @ A[JOINTS]))


class SelfMotionTracer:
    """All self-motion curves of a seven-axis arm.

    Args:
        chain: The arm.
    """

    def __init__(self, chain: SerialChain) -> None:
        self._chain = chain
        A = chain.placements
        methods = [(JOINTS - 1, method_of(A[:JOINTS])), (0, method_of(A[1:]))]
        ways = [_Sweep(held, A, method) for held, method in methods if not isinstance(method, float)]
        self._reach = float(np.linalg.norm(A[1:, :3, 3], axis=1).sum())
        self._sweeps = sorted(ways, key=lambda sweep: -sweep.method.rank)

    @property
    def sound(self) -> bool:
        """Whether a six-axis arm that is left can be solved."""
        return bool(self._sweeps)

    def curves(self, T: Floats) -> list[tuple[Floats, bool]]:
        """Compute all curves of a pose of the tip, shape (4, 4).

        Returns:
            For each curve postures along it [rad], shape (m, 7), without jumps, and whether it is closed.
        """
        if np.linalg.norm(T[:3, 3] - self._chain.placements[0][:3, 3]) > self._reach:
            return []
        best = self._sweeps[0]
        finer = [(best, FINER)] if best.method.rank else []  # a short curve may lie between two values
        for sweep, fineness in [*((each, 1) for each in self._sweeps), *finer]:
            values = sweep.values(fineness)
            nodes = self._swept(sweep, values, T)
            if nodes:
                return self._with_short_ones(self._traced(sweep, values, nodes, T), T)
        return self._with_short_ones([], T)

    def _with_short_ones(self, curves: list[tuple[Floats, bool]], T: Floats) -> list[tuple[Floats, bool]]:
        """Add closed curves that lie between two held values.

        For such a value the six-axis arm only just misses the pose; from there Newton's method with all seven joints
        leads to the curve.
        """
        sweep = self._sweeps[0]
        values = sweep.values(1)
        near = [
            np.insert(sweep.method.nearly(pose, AMISS), sweep.held, value, axis=1)
            for value, pose in zip(values, sweep.poses(values, T), strict=True)
        ]
        q = self._nearest(np.vstack(near), T)
        while len(q):
            known = np.vstack([curve for curve, _ in curves]) if curves else np.empty((0, JOINTS))
            new = [
                posture
                for posture in q
                if np.abs(wrapped(known - posture)).max(axis=1, initial=0.0).min(initial=9.0) > LONGEST
            ]
            if not new:
                break
            curves, q = [*curves, self._loop(new[0], T)], np.array(new[1:])
        return curves

    def _nearest(self, q: Floats, T: Floats) -> Floats:
        """Bring postures (m, 7) to a pose by the shortest steps; those that arrive."""
        off = np.full(len(q), np.inf)
        for _ in range(3 * NEWTON if len(q) else 0):
            error = miss(self._chain.fk(q)[:, :3], T[None])
            off = np.abs(error).max(axis=1)
            if (off < ON_CURVE).all():
                break
            step = (np.linalg.pinv(self._chain.jacobian(q)) @ error[:, :, None])[:, :, 0]
            q = q + step * np.minimum(1.0, 0.3 / np.maximum(np.abs(step).max(axis=1), 0.3))[:, None]
        return wrapped(q[off < 1e-10])

    def _loop(self, q: Floats, T: Floats) -> tuple[Floats, bool]:
        """Follow one curve from a posture until it comes back."""
        tangent = np.linalg.svd(self._chain.jacobian(q[None])[0])[2][-1]
        postures, at, step, way = [q], q, 0.25 * LONGEST, tangent
        for _ in range(20 * MAX_STEPS):
            trial, ahead, off = self.corrected((at + step * way)[None], T, way[None])
            if off[0] > 1e-10 or ahead[0] @ way < STRAIGHT:
                step *= 0.5
                if step < SHORTEST:
                    return np.array(postures), False
                continue
            at, way = trial[0], ahead[0]
            back = wrapped(q - at)
            if len(postures) > 2 and np.linalg.norm(back) < 1.5 * step and back @ way >= 0.0:
                return np.array([*postures, at] if np.linalg.norm(back) > 1e-6 else postures), True
            postures.append(at)
            step = min(LONGEST, 1.3 * step)
        return np.array(postures), False

    def _traced(self, sweep: _Sweep, values: Floats, nodes: list[_Node], T: Floats) -> list[tuple[Floats, bool]]:
        """Curves from the postures of a sweep."""
        held, count = sweep.held, len(values)
        new = list(range(len(nodes)))
        while new:  # what is reached and was not swept is followed, too
            known = len(nodes)
            self._link(nodes, new, T, 1, held, count)
            new = list(range(known, len(nodes)))
        while lonely := [index for index, node in enumerate(nodes) if -1 not in node.links]:
            known = len(nodes)
            self._link(nodes, lonely, T, -1, held, count)
            for index in lonely:
                nodes[index].links.setdefault(-1, (-1, 0, nodes[index].q[None]))
            self._link(nodes, list(range(known, len(nodes))), T, 1, held, count)
        for node in nodes:
            node.links.setdefault(1, (-1, 0, node.q[None]))
        return _joined(nodes)

    def corrected(
        self, q: Floats, T: Floats, direction: Floats, *, steps: int = NEWTON
    ) -> tuple[Floats, Floats, Floats]:
        """Bring postures to a pose by Newton's method, across a direction.

        Args:
            q: Postures near the curve [rad], shape (m, 7).
            T: Pose of the tip, shape (4, 4).
            direction: Along which they do not move, shape (m, 7).
            steps: Steps of Newton's method.

        Returns:
            Postures (m, 7); unit tangents of the curve there, nearest to the direction (m, 7); and how far the postures
            miss the pose [m, rad], shape (m,).
        """
        goal = T[None]
        A = np.empty((len(q), JOINTS, JOINTS))
        A[:, 6] = direction
        sides = np.zeros((len(q), JOINTS, 2))
        sides[:, 6, 1] = 1.0
        tangent, off = direction, np.full(len(q), np.inf)
        for step in range(steps + 1):
            error = miss(self._chain.fk(q)[:, :3], goal)
            off = np.abs(error).max(axis=1, initial=0.0)
            if step == steps or (step and (off < ON_CURVE).all()):
                break
            A[:, :6] = self._chain.jacobian(q)
            sides[:, :6, 0] = error
            found = np.linalg.solve(A + NUDGE * np.eye(JOINTS), sides)
            move = found[..., 0]
            q = q + move * np.minimum(1.0, 0.3 / np.maximum(np.abs(move).max(axis=1), 0.3))[:, None]
            tangent = found[..., 1] / np.linalg.norm(found[..., 1], axis=1)[:, None]
        return q, tangent, off

    def with_held(self, T: Floats, seed: Floats) -> Floats:
        """Compute every posture (k, 7) for poses (m, 4, 4) in which a joint at an end keeps a seed's value (7,)."""
        sweep = self._sweeps[0]
        value = np.full(len(T), seed[sweep.held])
        q, valid = sweep.method.many(sweep.poses(value, T), np.tile(np.delete(seed, sweep.held), (len(T), 1)), 1e-7)
        branch, row = np.nonzero(valid)
        return np.insert(q[:, branch, row].T, sweep.held, seed[sweep.held], axis=1)

    def tangents(self, q: Floats) -> Floats:
        """Compute unit tangents of a curve at its postures (m, 7), in their order: J t = 0, to rounding."""
        ahead = np.gradient(q, axis=0) if len(q) > 1 else np.ones((1, JOINTS))
        A = np.concatenate([self._chain.jacobian(q), ahead[:, None]], axis=1)
        side = np.zeros((len(q), JOINTS, 1))
        side[:, 6] = 1.0
        t = np.linalg.solve(A + NUDGE * np.eye(JOINTS), side)[..., 0]
        return np.asarray(t / np.linalg.norm(t, axis=1)[:, None])

    def _swept(self, sweep: _Sweep, values: Floats, T: Floats) -> list[_Node]:
        """Every posture with the held joint at one of its values."""
        poses = sweep.poses(values, T)
        q, valid = sweep.method.many(poses, np.zeros((len(poses), JOINTS - 1)), 1e-9)
        branch, value = np.nonzero(valid)
        if not len(value):
            return []
        postures = np.insert(q[:, branch, value].T, sweep.held, values[value], axis=1)
        direction = np.zeros_like(postures)
        direction[:, sweep.held] = 1.0
        postures, _, off = self.corrected(postures, T, direction)
        return [
            _Node(posture, int(v)) for posture, v, missed in zip(postures, value, off, strict=True) if missed < 1e-9
        ]

    def _link(self, nodes: list[_Node], which: list[int], T: Floats, way: int, held: int, count: int) -> None:
        """Follow the curve from some nodes one way, and link them with where it leads; add nodes that are not known.

        Args:
            nodes: All nodes.
            which: Indices of those to follow the curve from.
            T: Pose of the tip.
            way: Direction of the held joint, 1 or -1.
            held: Index of the held joint.
            count: Number of its values.
        """
        which = [index for index in which if way not in nodes[index].links]
        if not which:
            return
        by_value: dict[int, list[int]] = {}
        for index, node in enumerate(nodes):
            by_value.setdefault(node.value, []).append(index)
        starts = np.array([nodes[index].q for index in which])
        for index, piece, turned in self._followed(starts, T, way, held, TURN / count):
            start = which[index]
            value = nodes[start].value if turned else (nodes[start].value + way) % count
            there = by_value.setdefault(value, [])
            end = piece[-1]
            apart = [float(np.abs(wrapped(nodes[other].q - end)).max()) for other in there]
            if apart and min(apart) < SAME:
                other = there[int(np.argmin(apart))]
            else:
                other = len(nodes)
                nodes.append(_Node(wrapped(end), value))
                there.append(other)
            arriving = way if turned else -way
            nodes[start].links.setdefault(way, (other, arriving, piece))
            nodes[other].links.setdefault(arriving, (start, way, piece[::-1]))

    def _followed(self, q: Floats, T: Floats, way: int, held: int, gap: float) -> list[tuple[int, Floats, bool]]:
        """Follow curves from postures (m, 7) until the held joint has its next value, or its own again.

        Returns:
            Of each curve that arrives: its row, postures along it (k, 7), and whether the held joint has turned.
        """
        count, level = len(q), q[:, held].copy()
        along = np.zeros_like(q)
        along[:, held] = way
        _, tangent, _ = self.corrected(q, T, along, steps=1)
        pieces = [[posture.copy()] for posture in q]
        step, arrived = np.full(count, 0.5 * LONGEST), []
        going = np.arange(count)
        for _ in range(MAX_STEPS):
            if not len(going):
                break
            trial, ahead, off = self.corrected(q[going] + step[going, None] * tangent[going], T, tangent[going])
            good = (off < 1e-10) & ((ahead * tangent[going]).sum(axis=1) > STRAIGHT)
            at_start = q[going, held] == level[going]
            good &= ~at_start | (way * (trial[:, held] - level[going]) > 0.0)  # not over a turn in the first step
            step[going[~good]] *= 0.5
            moved = going[good]
            before = q[moved]
            q[moved], tangent[moved] = trial[good], ahead[good]
            step[moved] = np.minimum(LONGEST, 1.3 * step[moved])
            rise = way * (q[moved, held] - level[moved])
            over, turned = rise >= gap, rise <= 0.0
            ends = np.flatnonzero(over | turned)
            if len(ends):
                goals = level[moved[ends]] + np.where(over[ends], way * gap, 0.0)
                landed = self._landed(before[ends], q[moved[ends]], goals, T, held)
                for end, posture in zip(ends, landed, strict=True):
                    if posture is not None:
                        row = int(moved[end])
                        arrived.append((row, np.array([*pieces[row], posture]), bool(turned[end])))
            for row in np.delete(moved, ends):
                pieces[row].append(q[row].copy())
            going = np.setdiff1d(going[step[going] > SHORTEST], moved[ends], assume_unique=True)
        return arrived

    def _landed(self, before: Floats, after: Floats, level: Floats, T: Floats, held: int) -> list[Floats | None]:
        """Postures between two of each curve at which the held joint has a value."""
        share = (level - before[:, held]) / (after[:, held] - before[:, held])
        q = before + np.clip(share, 0.0, 1.0)[:, None] * (after - before)
        q[:, held] = level
        direction = np.zeros_like(q)
        direction[:, held] = 1.0
        q, _, off = self.corrected(q, T, direction, steps=2 * NEWTON)
        near = np.linalg.norm(q - before, axis=1) < 1.5 * LONGEST
        return [posture if good else None for posture, good in zip(q, (off < 1e-9) & near, strict=True)]


def _joined(nodes: list[_Node]) -> list[tuple[Floats, bool]]:
    """Put the pieces together."""
    curves: list[tuple[Floats, bool]] = []
    seen: set[int] = set()
    for first in range(len(nodes)):
        if first in seen:
            continue
        ahead, closed, visited = _walked(nodes, first, 1)
        seen |= visited
        if not closed:
            behind, _, visited = _walked(nodes, first, -1)
            seen |= visited
            ahead = np.vstack([behind[:0:-1], ahead])
        if len(ahead) > 1:
            curves.append((ahead, closed))
    return curves


def _walked(nodes: list[_Node], first: int, way: int) -> tuple[Floats, bool, set[int]]:
    """Postures from a node on, without jumps, whether the way leads back to it, and the nodes on it."""
    postures, visited, at = [nodes[first].q], {first}, first
    while True:
        other, arriving, piece = nodes[at].links[way]
        if other < 0:
            return np.array(postures), False, visited
        shift = TURN * np.rint((postures[-1] - piece[0]) / TURN)
        postures += list(piece[1:] + shift)
        if other == first:
            return np.array(postures[:-1]), True, visited
        if other in visited:  # a branch point: two curves cross
            return np.array(postures), False, visited
        visited.add(other)
        at, way = other, -arriving

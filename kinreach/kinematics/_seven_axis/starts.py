"""Postures of a seven-axis arm's pose from which its curves are followed: some on every curve.

**One joint held.** A pose closes the arm to a ring of seven joints. If any one of them is held, the six others are a
six-axis arm, from the joint behind it around the ring to the joint before it; its tip is turned back by the held
joint's angle, or moved back by a slide. That arm has finitely many postures, by closed form or elimination
(`method_of`). Every joint is held in turn, at values all around its circle: a curve along which one joint goes from
one value to the next is met. Of a curve that lies between two values of every joint the postures only just do not
exist: they are pairs of complex solutions, whose real part is near the curve. Newton's method with all seven joints
goes from these, too. Where it goes nowhere, a curve may only just not exist, or hide: the joint is also held halfway
to the values on both sides, twice.

Elimination is singular for some arms, such as those with a spherical shoulder and a spherical wrist. Then it solves one
that is `ERROR` off; Newton's method takes that away. For special poses, too, the ring may be such an arm.

**A slide.** Of an arm with a slide at an end only that is held, at more values, all along the way on which the others
reach the pose: with another joint held the ring has a slide, which elimination does not take.

**Singular postures.** Beside a posture at which the tip cannot move along one twist u, the poses depend on two
directions of the joints only by a quadratic form. The curves are close to conics: small closed ones, two branches of a
hyperbola, or two lines that cross. Newton's method is slow and erratic there. Instead, the middle of the conic is
computed, where the gradient of u's component vanishes along both directions, and the starts are its vertices.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach._rotations import turns_about_z, wrapped
from kinreach.kinematics._core import doubles, lib
from kinreach.kinematics._general_6r import Chain, General6R, moves_along_z
from kinreach.kinematics._six_axis.methods import IKMethod, method_of
from kinreach.robots.inside import moved_frames

JOINTS = 7
#: Values at which each joint is held, and how often their distance is halved around those that leave a doubt.
VALUES, HALVINGS = 8, 2
#: By how many times more a slide is held, which alone is.
OF_A_SLIDE = 32
#: Where the first value is, in shares of their distance: no value is a quarter of a turn, where arms are singular.
FIRST = 0.2
#: How far the arm is off of which a pose is solved by elimination, at each joint [m, rad].
ERROR = 1e-5
#: Random postures by which the end is chosen from which it is solved.
TRIALS = 20
#: Multiples of it, modulo 1, are spread evenly.
GOLDEN = 0.6180339887498949
#: Newton's method ends where a posture misses a pose by less; one that it cannot improve may miss it by more [m, rad].
REACHED, NOT_BETTER = 1e-13, 1e-11
#: Steps of Newton's method; after so many only what misses the pose by less goes on [m, rad].
STEPS, NEAR = 12, 1e-4
#: Steps without it where that is slow, and singular values below this share of the largest are 0 there.
POLISHING, ROUNDING = 8, 1e-12
#: Random starts where there are no others, and steps from them.
RANDOM, RANDOM_STEPS = 128, 40
#: A curve is not followed at a posture at which the Jacobian's smallest singular value is less than this, or than so
#: many times the root of the curvature [m/rad^2, 1/rad]: by rounding, it may be on another curve.
SINGULAR, SINGULAR_BY_CURVATURE = 1e-9, 1e-5
#: With a curvature below this such a posture is one of a surface [m/rad^2, 1/rad].
FLAT = 1e-3
#: Steps to the middle of a conic, and the shortest one [rad].
CENTRE_STEPS, CENTRED = 12, 1e-9
#: A conic's middle itself reaches the pose if it misses it by less [m, rad].
CROSSING = 1e-12
#: Farthest vertex of a conic from its middle [rad].
FARTHEST = 0.3
#: Longest step of a joint in Newton's method [rad].
MAX_JOINT_STEP = 0.3
#: What is added to a matrix before it is inverted.
NUDGE = 1e-14
#: Singular values below this share of the largest are 0.
RANK = 1e-8


#: Postures (m, 7) for values at which a joint is held (k,), and the value of each (m,).
HeldStarts = Callable[[Floats], tuple[Floats, Floats]]


class HeldEnd:
    """The first joint or the last held, and how the six others are solved."""

    def __init__(self, held: int, loop: Chain, method: IKMethod) -> None:
        self.held, self.method, self._placements, self._pitch = held, method, loop.placements, loop.pitches[held]

    def at(self, T: Floats) -> HeldStarts:
        """Return what computes postures near those of a pose (4, 4) with the joint at some values."""

        def starts(values: Floats) -> tuple[Floats, Floats]:
            q, which = self.method.starts(self.poses(values, T))
            return np.insert(q, self.held, values[which], axis=1), values[which]

        return starts

    def poses(self, values: Floats, T: Floats) -> Floats:
        """Compute poses of the six-axis arm for values of the held joint, shape (m, 4, 4)."""
        moves, A = moves_along_z(values, self._pitch), self._placements
        if self.held == 0:
            return np.linalg.inv(A[0] @ moves) @ T
        return T @ np.linalg.inv(moves @ A[JOINTS])


class HeldBetween:
    """Another joint held, and the six others around the ring solved by elimination."""

    def __init__(self, held: int, placements: Floats) -> None:
        self.held, A = held, placements
        self._order = (held + 1 + np.arange(JOINTS - 1)) % JOINTS
        rng = np.random.default_rng(held)
        errors = moved_frames(np.tile(np.eye(4), (JOINTS, 1, 1)), rng.uniform(-ERROR, ERROR, (JOINTS, 6)))
        ring = np.array([np.eye(4), *A[1:JOINTS]])[(held + 1 + np.arange(JOINTS)) % JOINTS] @ errors
        # around the ring both ways, without the link that depends on the pose
        self._links = ring, np.linalg.inv(ring[::-1])
        self._open = JOINTS - 1 - held
        self._before, self._behind = A[JOINTS], A[0] @ errors[self._open]
        q, T = rng.uniform(-np.pi, np.pi, (TRIALS, JOINTS - 1)), np.eye(4)
        T[:3] = Chain(placements).fk(rng.uniform(-np.pi, np.pi, (1, JOINTS)))[0]
        ways = [self._six(T, backwards=backwards) for backwards in (False, True)]
        shares = [six.tried(postures) for six, postures in zip(ways, (q, -q[:, ::-1]), strict=True)]
        # an eigenvalue that leads nowhere has taken the place of no posture, but it costs time
        worth = [share - 1e-3 * six.spurious for share, six in zip(shares, ways, strict=True)]
        self._backwards = worth[1] > worth[0]

    def at(self, T: Floats) -> HeldStarts:
        """As `HeldEnd.at`."""
        six = self._six(T, backwards=self._backwards)

        def starts(values: Floats) -> tuple[Floats, Floats]:
            found, which = six.starts(turns_about_z(values if self._backwards else -values))
            q = np.empty((len(found), JOINTS))
            q[:, self.held] = values[which]
            q[:, self._order] = -found[:, ::-1] if self._backwards else found
            return q, values[which]

        return starts

    def _six(self, T: Floats, *, backwards: bool) -> General6R:
        """The six other joints, from one end of the ring or the other."""
        links, link = self._links[backwards].copy(), self._before @ np.linalg.inv(T) @ self._behind
        links[self.held if backwards else self._open] = np.linalg.inv(link) if backwards else link
        return General6R(Chain(links))


class Starts:
    """Postures of a pose on every curve, and Newton's method that brings them there."""

    def __init__(self, loop: Chain) -> None:
        A = loop.placements
        self.loop = loop
        slides, turns_alone = loop.slides, not loop.slides.any()
        others = {JOINTS - 1: A[:JOINTS], 0: A[1:]}
        methods = [(held, method_of(A)) for held, A in others.items() if turns_alone or slides[held]]
        ends = [HeldEnd(held, loop, method) for held, method in methods if not isinstance(method, float)]
        self.ends = sorted(ends, key=lambda end: -end.method.rank)
        known = {end.held: end for end in self.ends if end.method.starts_all or not turns_alone}
        self._held: list[HeldEnd | HeldBetween] = [
            *known.values(),
            *(HeldBetween(held, A) for held in range(JOINTS) if ends and held not in known and turns_alone),
        ]
        self.values, self.halvings = VALUES, HALVINGS

    @property
    def _A(self) -> Any:
        return doubles(self.loop.core)

    def of(self, T: Floats) -> Floats:
        """Compute postures (m, 7) of a pose (4, 4), in [-pi, pi]."""
        slide = self.loop.slides.any()
        ways, half, count = [way.at(T) for way in self._held], np.pi, self.values
        if slide:  # beyond, the pose is out of the reach of the other joints
            half, count = 1.0, OF_A_SLIDE * self.values
        apart, around = 2.0 * half / count, np.linspace(-half, half, count, endpoint=False)
        wanted = [around + apart * ((FIRST + GOLDEN * way.held) % 1.0) for way in self._held]
        found, missed = [], []
        for _ in range(self.halvings + 1):
            starts = [way(values) for way, values in zip(ways, wanted, strict=True)]
            owner = np.repeat(np.arange(len(ways)), [len(q) for q, _ in starts])
            every, held = np.vstack([q for q, _ in starts]), np.concatenate([values for _, values in starts])
            finite = np.isfinite(every).all(axis=1)
            q, off = self._newton(every[finite], T, STEPS)
            found.append(q)
            missed.append(off)
            apart *= 0.5
            doubtful = off >= REACHED
            held, owner = held[finite][doubtful], owner[finite][doubtful]
            beside = wrapped(np.concatenate([held - apart, held + apart]))
            wanted = [np.unique(np.round(beside[np.tile(owner == way, 2)], 9)) for way in range(len(ways))]
            if not len(held):
                break
        q = self._ended(np.vstack(found), np.concatenate(missed), T)
        if not len(q):  # every arm that is left may be singular, as where a folded arm's wrist is in its shoulder
            anywhere = np.random.default_rng(0).uniform(-np.pi, np.pi, (RANDOM, JOINTS))
            q = self.reached(anywhere, T, steps=RANDOM_STEPS)
        return q

    def reached(self, q: NDArray[Any], T: Floats, *, steps: int = STEPS) -> Floats:
        """Bring postures (m, 7) to a pose by the shortest steps; those that arrive, and those beside singular ones."""
        return self._ended(*self._newton(q, T, steps), T)

    def across(self, q: Floats, T: Floats) -> Floats:
        """The postures (k, 7) of a pose on both sides of singular ones beside its postures (m, 7)."""
        return wrapped(self._arrived(*self._newton(self._vertices(q, T), T, STEPS), T)[0])

    def _ended(self, q: Floats, off: Floats, T: Floats) -> Floats:
        """Postures that arrived where Newton's method ended, and those on both sides of singular ones beside others."""
        q, near = self._arrived(q, off, T)
        return np.vstack([wrapped(q), self.across(near, T)]) if len(near) else wrapped(q)

    def _newton(self, q: Floats, T: Floats, steps: int) -> tuple[Floats, Floats]:
        """Postures where Newton's method by the shortest steps ends, and how far they miss the pose."""
        q, off = np.array(q, order="C"), np.empty(len(q))
        lib.kr_shortest_steps(self._A, doubles(T), steps, len(q), doubles(q), doubles(off))
        return q, off

    def _arrived(self, q: Floats, off: Floats, T: Floats) -> tuple[Floats, Floats]:
        """Postures that arrived, those after polishing, too, in their order, and those that are near but slow."""
        slow = (off >= REACHED) & (off < NEAR)
        if not slow.any():
            return q[off < REACHED], q[:0]
        q[slow], off[slow] = self._polished(q[slow], T)
        slow &= off >= NOT_BETTER
        return q[(off < NOT_BETTER) & ~slow], q[slow]

    def _polished(self, q: Floats, T: Floats) -> tuple[Floats, Floats]:
        """Postures (m, 7) brought nearer to a pose where `NUDGE` slows Newton's method, and how far they miss it (m,).

        Two pairs of axes that almost coincide make a small singular value, although the curve there is regular.
        """
        best, best_off, going = q.copy(), self.loop.step(q, T[None])[2], np.arange(len(q))
        for _ in range(POLISHING):
            going = going[best_off[going] >= REACHED]
            if not len(going):
                break
            error, J, _ = self.loop.step(q[going], T[None])
            q[going] += limited((np.linalg.pinv(J, rcond=ROUNDING) @ error[..., None])[..., 0])
            off = self.loop.step(q[going], T[None])[2]
            better = off < best_off[going]
            best[going[better]], best_off[going[better]] = q[going[better]], off[better]
        return best, best_off

    def _vertices(self, q: Floats, T: Floats) -> Floats:
        """Vertices (k, 7) of the conics that a pose's curves are, beside singular postures near some (m, 7)."""
        q = q.copy()
        for _ in range(CENTRE_STEPS):
            error, (U, s, V), form = self._second_order(q, T)
            A = np.concatenate([s[:, :5, None] * V[:, :5], V[:, 5:] @ form], axis=1)
            wanted = (error[:, None] @ U)[:, 0]
            wanted[:, 5] = -s[:, 5]
            step = limited((np.linalg.pinv(A, rcond=RANK) @ np.pad(wanted, ((0, 0), (0, 1)))[..., None])[..., 0])
            q += step
            if np.abs(step).max() < CENTRED:
                break
        error, (U, _, V), form = self._second_order(q, T)
        plane = V[:, 5:]
        curvature, axes = np.linalg.eigh(plane @ form @ plane.transpose(0, 2, 1))
        level = (error * U[:, :, 5]).sum(axis=1)
        square = 2.0 * level[:, None] / np.where(curvature == 0.0, np.finfo(float).tiny, curvature)
        radius = np.sqrt(np.maximum(square, 0.0))
        ways = (radius[:, :, None] * axes.transpose(0, 2, 1)) @ plane  # (m, 2, 7)
        good = (square > 0.0) & (radius < FARTHEST)
        crossing = np.abs(level) < CROSSING
        both = np.concatenate([q[:, None] + ways, q[:, None] - ways])[np.concatenate([good, good])]
        return np.vstack([both, q[crossing]])

    def least_singular_values(self, q: Floats) -> Floats:
        """Compute the smallest singular values of the Jacobians at postures (m, 7), to about 3e-8, shape (m,)."""
        q, values = np.ascontiguousarray(q), np.empty(len(q))
        lib.kr_least_singular_values(self._A, len(q), doubles(q), doubles(values))
        return values

    def singular(self, q: Floats, T: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Floats]:
        """Which of a pose's postures (m, 7) are singular, which are on a surface of them, and their last twists (m, 6).

        Two directions in which the joints move without the tip are on one, as far as second derivatives tell.
        """
        singular = self.least_singular_values(q) < SINGULAR_BY_CURVATURE
        surface, twists = np.zeros(len(q), dtype=np.bool_), np.zeros((len(q), 6))
        if singular.any():
            _, (U, last, V), form = self._second_order(q[singular], T)
            twists[singular] = U[:, :, 5]
            inexact = self.loop.step(q[singular], T[None])[2] >= REACHED
            plane = V[:, 5:]
            curvature = np.abs(np.linalg.eigvalsh(plane @ form @ plane.transpose(0, 2, 1))).max(axis=1)
            lost = inexact | (last[:, 5] < np.maximum(SINGULAR, SINGULAR_BY_CURVATURE * np.sqrt(curvature)))
            surface[singular], singular[singular] = lost & (curvature < FLAT), lost
        return singular, surface, twists

    def _second_order(self, q: Floats, T: Floats) -> tuple[Floats, tuple[Floats, Floats, Floats], Floats]:
        """Errors (m, 6), the Jacobians' singular values, and the second derivatives (m, 7, 7) along the last twist."""
        error, J, _ = self.loop.step(q, T[None])
        U, s, V = np.linalg.svd(J)
        v, w = J[:, :3].transpose(0, 2, 1), J[:, 3:].transpose(0, 2, 1)
        uv, uw = U[:, None, :3, 5], U[:, None, 3:, 5]
        # u . [J_i, J_k], the Lie bracket of two twists; of the product of exponentials only i < k counts
        bracket = np.cross(uv, w) @ v.transpose(0, 2, 1)
        bracket = np.triu(bracket - bracket.transpose(0, 2, 1) + np.cross(uw, w) @ w.transpose(0, 2, 1), k=1)
        return error, (U, s, V), 0.5 * (bracket + bracket.transpose(0, 2, 1))


def limited(steps: NDArray[Any]) -> Floats:
    """Shorten steps (m, 7) to at most `MAX_JOINT_STEP` a joint."""
    longest = np.maximum(np.abs(steps).max(axis=1), MAX_JOINT_STEP)
    return steps * (MAX_JOINT_STEP / longest)[:, None]

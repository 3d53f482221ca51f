"""An arm fitted to pairs of joint angles and poses: which model it is, which rows belong to it, what they determine.

The fit is `kinreach.robots._identification` with a prior at the size of real deviations; a UR's own structure is kept
(the base's z axis is that of the first joint, the flange's that of the last). Rows that do not fit are dropped and
named. What the rows do not determine stays at the data sheet, and the expected error over the workspace says so.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kinreach._checks import Floats, check_known, check_path, listed
from kinreach._files import read_bytes
from kinreach._rotations import listed_pose
from kinreach.errors import InputError
from kinreach.robots._calibration import (
    PUBLISHED_CALIBRATIONS,
    Calibration,
    calibration_of,
    calibrations_in,
    is_calibration,
    nominal_placements,
)
from kinreach.robots._identification import IdentifiedArm, Prior, frames_of, turns_between
from kinreach.robots._pairs import PosePairs, looks_like_rows, pairs_of
from kinreach.robots._polyscope import is_program
from kinreach.robots._ur import FLIP, JOINTS, UR_LENGTHS
from kinreach.robots._urdf_chain import UrdfChain

#: Standard deviations of a link's translation [m] and turn [rad]: real ones reach 6.9 mm and 17 mrad.
LINK = (3e-3, 5e-3)
#: Those of a frame that is not known, and of one that is [m], [rad].
UNKNOWN, KNOWN = (1.0, 3.0), (0.0, 0.0)
#: Least noise that is believed [m], [rad]; most rows of a fit, and by how much their postures differ [rad].
LEAST_NOISE, MAX_ROWS, APART = (1e-11, 1e-11), 400, 0.02
#: Fewest different postures.
MIN_ROWS = 3
#: Errors of the data sheet up to which rows are those of a model [m], [rad].
FITS = (0.025, 0.05)
#: By how much the right model must be better than others.
CLEARLY = 3.0
#: By how much the sum of squared deviations must differ, each in its standard deviation, to tell models.
TELLING = 12.0
#: Noises beyond which a row is dropped, and the largest share of them.
OUTLIER, MOST_DROPPED = 6.0, 0.4
#: Postures of the workspace on which the expected error is judged.
WORKSPACE = 400
#: A calibration is used if the expected error is below this share of its correction, or below this [m]. Corrections
#: count up to what data sheets usually miss [m]: a fit that is not determined corrects by more.
BETTER, GOOD, USUAL = 0.5, 1e-5, 2e-3
#: Turn of a joint below which rows say little of it [rad].
STILL = 0.3


@dataclass(frozen=True, eq=False)
class CalibrationFit:
    """What a fit rests on, and how good it is. Lengths in m.

    Attributes:
        rows: Number of rows that were fitted.
        dropped: Rows that were left out, each with the reason.
        before, after: Errors of the positions at the rows by the data sheet and by the calibration, shape (rows,).
        held_out: The same at rows that were left out of the fit, each once, shape (rows,).
        positions: Of the tool over the workspace, shape (k, 3).
        correction: Distance there between data sheet and calibration, shape (k,).
        expected: Expected error there that is left, root mean square, by the covariance, shape (k,).
        covariance: Of the free parameters of the frames, [m] and [rad], shape (p, p).
    """

    rows: int
    dropped: tuple[tuple[str, str], ...]
    before: Floats
    after: Floats
    held_out: Floats
    positions: Floats
    correction: Floats
    expected: Floats
    covariance: Floats


class Fitted(NamedTuple):
    """What rows say of an arm.

    Attributes:
        placements: A0 to An of the arm, shape (n + 1, 4, 4); with the base in the frame of the poses, and the tool.
        models, tcp, tcp_found, fit, missing, notes: As in `kinreach.robots._calibrate.CalibratedArm`.
        base: Of the arm in the frame of the poses, shape (4, 4).
    """

    placements: Floats
    models: tuple[str, ...]
    tcp: Floats | None
    tcp_found: bool
    fit: CalibrationFit
    missing: str
    notes: tuple[str, ...]
    base: Floats


class _Rows(NamedTuple):
    """Rows as they are fitted.

    Attributes:
        q: [rad], shape (m, n).
        seen: Poses (m, 4, 4) or positions (m, 3) of the flange if the tool is known, else of the tool.
        tool_known: Whether they are of the flange.
    """

    q: Floats
    seen: Floats
    tool_known: bool

    @property
    def has_rotations(self) -> bool:
        return self.seen.ndim == 3

    def part(self, rows: Any) -> _Rows:
        return self._replace(q=self.q[rows], seen=self.seen[rows])


def _rows_of(pairs: PosePairs) -> _Rows:
    """The rows; of the flange where the tool is known."""
    if pairs.tcp is None or not pairs.has_rotations:
        return _Rows(pairs.q, pairs.seen, False)
    return _Rows(pairs.q, pairs.seen @ np.linalg.inv(pairs.tcp), True)


def _thinned(pairs: PosePairs) -> PosePairs:
    """At most `MAX_ROWS` rows with different postures."""
    kept: list[int] = []
    for row, q in enumerate(pairs.q):
        if (
            not kept
            or (len(pairs) <= MAX_ROWS and np.abs(pairs.q[kept] - q).max(axis=1).min() > 1e-9)
            or (len(pairs) > MAX_ROWS and np.abs(q - pairs.q[kept[-1]]).max() > APART)
        ):
            kept.append(row)
    if len(kept) > MAX_ROWS:
        kept = [kept[index] for index in np.linspace(0, len(kept) - 1, MAX_ROWS).astype(int)]
    spread = np.ptp(pairs.q[kept], axis=0).max()
    if len(kept) < MIN_ROWS or spread < APART:
        raise InputError(
            f"{pairs.source} has {len(kept)} different posture{'s' * (len(kept) != 1)}, whose joints differ by "
            f"{spread:.2g} rad at most: six or more are needed in which every joint differs by 1 rad"
        )
    return pairs.rows(kept)


def _aligned(placements: Floats, rows: _Rows) -> tuple[Floats, Floats]:
    """The tool that explains the rows best by a chain, shape (4, 4), and the errors that are left [m], (m,).

    Of an angle `FITS` says which length it is worth.
    """
    F = frames_of(placements, rows.q)[-1]
    tool = np.eye(4) if rows.tool_known else PosePairs("", rows.q, rows.seen).tool_on(F)
    apart, turned = _errors(F @ tool, rows.seen)
    return tool, np.asarray(np.hypot(apart, turned * FITS[0] / FITS[1]))


class _Guess(NamedTuple):
    """A model with the rows as it explains them."""

    model: str
    rows: _Rows
    error: float
    note: str


def _twins(model: str) -> tuple[str, ...]:
    """The models with the data sheet of a model, itself among them."""
    return tuple(name for name, lengths in UR_LENGTHS.items() if lengths == UR_LENGTHS[model])


#: Models, the first of each data sheet.
_MODELS = tuple(model for model in UR_LENGTHS if model == _twins(model)[0])


def _guesses(rows: _Rows, note: str = "") -> list[_Guess]:
    """Models in the order of their errors, one of each data sheet."""
    errors = {model: float(np.median(_aligned(nominal_placements(model), rows)[1])) for model in _MODELS}
    return [_Guess(model, rows, errors[model], note) for model in sorted(errors, key=errors.__getitem__)]


def fitted_ur(model: str | None, pairs: PosePairs) -> Fitted:
    """Find which UR rows are of, and fit its frames between base and flange.

    Raises:
        InputError: As `kinreach.robots.calibrate`.
    """
    pairs = _thinned(pairs)
    if pairs.q.shape[1] != len(JOINTS):
        raise InputError(f"a UR has six joints, {pairs.source} has {pairs.q.shape[1]}")
    rows = _rows_of(pairs)
    guesses = _guesses(rows)
    if guesses[0].error > FITS[0]:
        guesses = _repaired(pairs, rows)
    best = guesses[0]
    twins = _twins(best.model)
    if model is not None and model not in twins:
        own = next(guess for guess in guesses if guess.model in _twins(model))
        if own.error > CLEARLY * best.error:
            raise InputError(
                f"the rows of {pairs.source} are those of a {' or '.join(twins)}, not of a {model}: the data sheets "
                f"are {millimetres(best.error)} and {millimetres(own.error)} mm off"
            )
        best, twins = own, (model,)
    elif model is not None:
        twins = (model,)
    elif len(guesses) > 1 and guesses[1].error < CLEARLY * best.error:
        best = _likelier(guesses[:3], pairs)
        twins = _twins(best.model)
    nominal = nominal_placements(twins[0])
    start, prior = _ur_start(best)
    fit = _fit(start, best.rows, prior, pairs)
    found = not best.rows.tool_known
    tcp = np.linalg.inv(nominal[-1]) @ fit.arm.placements[-1] if found else pairs.only_tcp
    errors, missing = _judged(fit, JOINTS)
    notes = (*pairs.notes, *[best.note] * bool(best.note))
    if found and tcp is not None:
        notes += (f"the tool is fitted, too, and is only known together with the flange: use tool={listed_pose(tcp)}",)
    placements = np.array([*fit.arm.placements[:-1], nominal[-1]])
    return Fitted(placements, twins, tcp, found, errors, missing, notes, np.eye(4))


def _likelier(guesses: Sequence[_Guess], pairs: PosePairs) -> _Guess:
    """The model that needs the least deviation from its data sheet, where the data sheets alone do not decide.

    Raises:
        InputError: Two need about the same.
    """
    costs = []
    for guess in guesses:
        start, prior = _ur_start(guess)
        costs.append((_identified(start, guess.rows, prior, _digits(pairs))[0].cost, guess.model, guess))
    (least, _, best), (next_, other, _) = sorted(costs, key=lambda each: each[0])[:2]
    if next_ - least < TELLING:
        raise InputError(
            f"the rows of {pairs.source} do not tell a {best.model} from a {other}: name it with arm=, or add rows in "
            "which the joints differ more"
        )
    return best


def _ur_start(guess: _Guess) -> tuple[Floats, Prior]:
    """Placements by the data sheet with the tool that suits the rows, and how far each frame may be off."""
    nominal = nominal_placements(guess.model)
    start = np.array([*nominal[:-1], nominal[-1] @ _aligned(nominal, guess.rows)[0]])
    return start, Prior(base=KNOWN, links=LINK, tool=_tool_prior(guess.rows))


def _tool_prior(rows: _Rows) -> tuple[float, float]:
    """How far the tool may be off [m], [rad]; positions say nothing of how it is turned."""
    if rows.tool_known:
        return KNOWN
    return UNKNOWN if rows.has_rotations else (UNKNOWN[0], 0.0)


def _repaired(pairs: PosePairs, rows: _Rows) -> list[_Guess]:
    """Guesses for rows that no model explains as they are: another frame, order of joints, or tool.

    Raises:
        InputError: Nothing explains them; what was tried is named.
    """
    few = rows.part(np.linspace(0, len(rows.q) - 1, min(len(rows.q), 12)).astype(int))
    ways: list[tuple[Any, str]] = [(_flipped, "the poses are in base_link, as ROS has it, not in base")]
    for order in _ORDERS:
        names = ", ".join(JOINTS[index].removesuffix("_joint") for index in np.argsort(order))
        ways.append((partial(_reordered, order=order), f"the columns of the joints are in the order {names}"))
    tried = [(_guesses(way(few))[0].error, index) for index, (way, _) in enumerate(ways)]
    error, index = min(tried)
    if error <= FITS[0]:
        return _guesses(ways[index][0](rows), ways[index][1])
    if rows.tool_known:
        loose = _Rows(pairs.q, pairs.seen, False)
        found = _guesses(loose)
        if found[0].error <= FITS[0]:
            tool, _ = _aligned(nominal_placements(found[0].model), loose)
            raise InputError(
                f"the tool centre point of {pairs.source} is not the one of its rows: they fit a {found[0].model} with "
                f"the tool {listed_pose(tool)}; give that with tool=, or check the installation's"
            )
    feature = _in_feature(pairs, rows)
    if feature:
        raise InputError(feature)
    raise InputError(
        f"the rows of {pairs.source} fit no model of UR ({millimetres(_guesses(rows)[0].error)} mm off at "
        "best), also not in the frame base_link, with joints in another order, another tool or a feature; for another "
        "arm give its URDF with arm="
    )


#: Orders that the columns of joints may have: reversed, by the alphabet as in ROS's joint_states, any two swapped.
_ORDERS = [[5, 4, 3, 2, 1, 0], [2, 1, 0, 3, 4, 5]]
_ORDERS += [
    [{one: other, other: one}.get(joint, joint) for joint in range(6)]
    for one, other in itertools.combinations(range(6), 2)
    if (one, other) != (0, 2)
]


def _reordered(rows: _Rows, order: list[int]) -> _Rows:
    return rows._replace(q=rows.q[:, order])


def _flipped(rows: _Rows) -> _Rows:
    """The rows with poses in base_link read as in base."""
    return rows._replace(seen=rows.seen @ FLIP[:3, :3] if not rows.has_rotations else FLIP @ rows.seen)


def _in_feature(pairs: PosePairs, rows: _Rows) -> str:
    """Describe the frame that poses are in, if a frame of their own explains them; else empty."""
    if not rows.has_rotations:
        return ""
    found = []
    for model in _MODELS:
        F = frames_of(nominal_placements(model), rows.q)[-1]
        base, tool = _hand_eye(F, rows.seen) if not rows.tool_known else (_rigid(F, rows.seen), np.eye(4))
        apart = np.linalg.norm((base @ F @ tool - rows.seen)[:, :3, 3], axis=1)
        found.append((float(np.median(apart)), model, base))
    error, model, base = min(found, key=lambda each: each[0])
    if error > FITS[0]:
        return ""
    inverse = listed_pose(np.asarray(np.linalg.inv(base)))
    return (
        f"the poses of {pairs.source} are in the frame of a feature, not of the base: they fit a {model} whose base "
        f"has the feature at {inverse}; export them in the feature Base"
    )


def _rigid(F: Floats, seen: Floats) -> Floats:
    """The motion B with B F = seen in the median."""
    from scipy.spatial.transform import Rotation

    X, base = seen @ np.linalg.inv(F), np.eye(4)
    base[:3, :3] = Rotation.from_matrix(X[:, :3, :3]).mean().as_matrix()
    base[:3, 3] = np.median(X[:, :3, 3], axis=0)
    return base


def _hand_eye(F: Floats, seen: Floats) -> tuple[Floats, Floats]:
    """The motions B and X with B F X = seen, by linear least squares: first rotations, then translations."""
    blocks = [np.kron(f[:3, :3].T, np.eye(3)) for f in F]
    system = np.concatenate(
        [np.hstack([block, -np.kron(np.eye(3), s[:3, :3])]) for block, s in zip(blocks, seen, strict=True)]
    )  # vec(B R_F) = vec(R_S X^T)
    vector = np.linalg.svd(system)[2][-1]
    B, Xt = (vector[part].reshape(3, 3, order="F") for part in (slice(0, 9), slice(9, 18)))
    sign = np.sign(np.linalg.det(B)) or 1.0
    B, Xt = (_nearest_rotation(sign * M) for M in (B, Xt))
    base, tool = np.eye(4), np.eye(4)
    base[:3, :3], tool[:3, :3] = B, Xt.T
    A = np.concatenate([np.hstack([np.eye(3), B @ f[:3, :3]]) for f in F])
    b = np.concatenate([s[:3, 3] - B @ f[:3, 3] for f, s in zip(F, seen, strict=True)])
    solution = np.linalg.lstsq(A, b, rcond=None)[0]
    base[:3, 3], tool[:3, 3] = solution[:3], solution[3:]
    return base, tool


def _nearest_rotation(M: Floats) -> Floats:
    U, _, V = np.linalg.svd(M)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V)


class _Fit(NamedTuple):
    """A fit and what it rests on.

    Attributes:
        arm: With the tool on its last frame.
        start: Placements of the data sheet with the tool that suits them best, shape (n + 1, 4, 4).
        rows: Those that were used.
        dropped, held_out: As in `CalibratedArm`.
    """

    arm: IdentifiedArm
    start: Floats
    rows: _Rows
    dropped: tuple[tuple[str, str], ...]
    held_out: Floats


def _fit(start: Floats, rows: _Rows, prior: Prior, pairs: PosePairs) -> _Fit:
    """Fit the frames to the rows that agree with each other.

    Raises:
        InputError: Too many rows do not agree; or they are of two tools or robots.
    """
    least = _digits(pairs)
    used = np.ones(len(rows.q), dtype=np.bool_)
    for _ in range(4):
        arm, noise = _identified(start, rows.part(used), prior, least)
        apart, turned = _errors(arm.poses(rows.q), rows.seen)
        off = (apart > np.maximum(OUTLIER * MEDIAN_NORM * noise[0], 2e-6)) | (
            turned > np.maximum(OUTLIER * MEDIAN_NORM * noise[1], 2e-6)
        )
        if (off == ~used).all():
            break
        if off.mean() > MOST_DROPPED:
            _refuse_two(start, rows, prior, pairs, noise, least)
            raise InputError(
                f"{off.sum()} of {len(off)} rows of {pairs.source} do not fit the others: joint angles and poses must "
                "be of the same moment, of one robot and one tool"
            )
        used = ~off
    _refuse_two(start, rows, prior, pairs, noise, least)
    dropped = tuple((pairs.place(row), f"{millimetres(apart[row])} mm off the others") for row in np.flatnonzero(~used))
    held_out = _held_out(start, rows.part(used), prior, noise)
    return _Fit(arm, start, rows.part(used), dropped, held_out)


#: Median length of a vector of three normal numbers of standard deviation 1.
MEDIAN_NORM = 1.538
#: Fewer spare equations than this say nothing about the noise.
SPARE = 12


def _digits(pairs: PosePairs) -> tuple[float, float]:
    """Noise by the last digit of the numbers: of positions [m] and rotations [rad]."""
    angle, length, turn = pairs.steps
    typed = angle if length > 1e-9 and angle < 1e-3 else 0.0
    return max((length + typed) / 3.5, LEAST_NOISE[0]), max((turn + typed) / 3.5, LEAST_NOISE[1])


def _identified(
    start: Floats, rows: _Rows, prior: Prior, least: tuple[float, float]
) -> tuple[IdentifiedArm, tuple[float, float]]:
    """The most probable arm with the noise that the rows show; rows count less the farther they are off."""
    noise, weights, poses = (1e-4, 1e-4), np.ones(len(rows.q)), rows.has_rotations
    for _ in range(25):
        arm = _most_probable(start, rows, prior, noise, weights)
        apart, turned = _errors(arm.poses(rows.q), rows.seen)
        equations = (6 if poses else 3) * len(rows.q)
        spare = equations - arm.determined
        lost = np.sqrt(equations / max(spare, equations / 9))
        known = LEAST_NOISE if spare > SPARE else least
        now = (
            max(float(np.median(apart)) * lost / MEDIAN_NORM, known[0]),
            max(float(np.median(turned)) * lost / MEDIAN_NORM, known[1]),
        )
        far = np.maximum(apart / now[0], turned / now[1] if poses else 0.0) / (4.0 * MEDIAN_NORM)
        weights = 1.0 / np.maximum(far, 1.0)
        settled = np.allclose(np.log(now), np.log(noise), atol=0.02)
        noise = now
        if settled:
            break
    return arm, noise


def _most_probable(
    start: Floats, rows: _Rows, prior: Prior, noise: tuple[float, float], weights: Floats | None = None
) -> IdentifiedArm:
    own = noise if rows.has_rotations else noise[0]
    return IdentifiedArm(start, rows.q, rows.seen, prior=prior, noise=own, weights=weights, steps=5)


def _errors(T: Floats, seen: Floats) -> tuple[Floats, Floats]:
    """Distances [m] and angles [rad] between poses (m, 4, 4) and what was seen there; angles 0 of positions."""
    if seen.ndim == 2:
        return np.linalg.norm(T[:, :3, 3] - seen, axis=1), np.zeros(len(seen))
    turned = np.linalg.norm(turns_between(T, seen), axis=1)
    return np.linalg.norm(T[:, :3, 3] - seen[:, :3, 3], axis=1), turned


def _held_out(start: Floats, rows: _Rows, prior: Prior, noise: tuple[float, float]) -> Floats:
    """Errors at rows by fits to the others [m], each row once, shape (m,)."""
    count = len(rows.q)
    fold = np.arange(count) % (count if count <= 20 else 10)
    errors = np.empty(count)
    for number in range(fold.max() + 1):
        out = fold == number
        arm = _most_probable(start, rows.part(~out), prior, noise)
        errors[out] = _errors(arm.poses(rows.q[out]), rows.seen[out])[0]
    return errors


def _refuse_two(
    start: Floats, rows: _Rows, prior: Prior, pairs: PosePairs, noise: tuple[float, float], least: tuple[float, float]
) -> None:
    """Refuse rows that are of one tool or robot up to a row, and of another from there on."""
    count = len(rows.q)
    if count < 16 or noise[0] < 3e-6:
        return
    found: list[tuple[float, int, list[tuple[IdentifiedArm, tuple[float, float]]]]] = []
    for row in sorted({int(count * part / 10) for part in range(2, 9)}, key=lambda row: abs(row - count / 2)):
        if found and min(part[1][0] for part in found[0][2]) > noise[0] / 2.0:
            return  # one half lies before or after a change, and would be better than the whole
        parts = [_identified(start, rows.part(side), prior, least) for side in (slice(0, row), slice(row, None))]
        found.append((max(part[1][0] for part in parts), row, parts))
    least_noise, row, parts = min(found, key=lambda each: each[0])
    if least_noise > noise[0] / 4.0:
        return
    place = pairs.place(row)
    before = parts[0][0]
    if rows.has_rotations:
        others = rows.part(slice(row, None))._replace(tool_known=False)
        change = _aligned(before.placements, others)[0]
        if np.median(_errors(before.poses(others.q) @ change, others.seen)[0]) < 10 * max(least_noise, 1e-6):
            raise InputError(
                f"the tool changes in {pairs.source} near {place}, by {listed_pose(change)}: give rows of one tool, "
                "or a recording with tcp_offset"
            )
    raise InputError(f"{pairs.source} has the rows of two robots or tools, one up to {place}: give those of one")


def _judged(fit: _Fit, names: Sequence[str]) -> tuple[CalibrationFit, str]:
    """The errors of a fit at the rows and over the workspace, and what the rows do not determine."""
    rows, joints = fit.rows, fit.rows.q.shape[1]
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (WORKSPACE, joints))
    positions = fit.arm.positions(q)
    correction = np.linalg.norm(positions - frames_of(fit.start, q)[-1][:, :3, 3], axis=1)
    expected = fit.arm.doubts(q)[0]
    errors = CalibrationFit(
        rows=len(rows.q),
        dropped=fit.dropped,
        before=_errors(frames_of(fit.start, rows.q)[-1], rows.seen)[0],
        after=_errors(fit.arm.poses(rows.q), rows.seen)[0],
        held_out=fit.held_out,
        positions=positions,
        correction=correction,
        expected=expected,
        covariance=fit.arm.covariance,
    )
    return errors, _missing(rows, names, float(np.median(expected)), float(np.median(correction)))


def _missing(rows: _Rows, names: Sequence[str], expected: float, correction: float) -> str:
    """Say what the rows do not determine; empty if the calibration is better than the data sheet."""
    if expected < max(BETTER * min(correction, USUAL), GOOD):
        return ""
    still = [name for name, turn in zip(names, np.ptp(rows.q, axis=0), strict=True) if turn < STILL]
    if len(rows.q) < 6:
        remedy = f"add rows: {len(rows.q)} are too few, six or more are needed"
    elif still:
        remedy = f"add rows in which {listed(still)} turn{'s' * (len(still) == 1)} by 1 rad or more"
    else:
        remedy = "add rows all over the workspace, or rows with more digits"
    return (
        f"the rows leave {millimetres(expected)} mm over the workspace, where they correct the data sheet by "
        f"{millimetres(correction)} mm: {remedy}"
    )


def fitted_chain(name: str, joints: Sequence[str], chain: UrdfChain, pairs: PosePairs) -> Fitted:
    """Fit the joint placements of any arm, with its base in the frame of the poses, and its tool."""
    if pairs.q.shape[1] != chain.joints:
        raise InputError(f"arm {name!r} has {chain.joints} joints, {pairs.source} has {pairs.q.shape[1]}")
    pairs = _thinned(pairs)
    rows, nominal = _rows_of(pairs), chain.placements
    F = frames_of(nominal, rows.q)[-1]
    if not rows.has_rotations:
        base, tool = _seen_from(F[:, :3, 3], rows.seen), np.eye(4)
    else:
        base, tool = (_rigid(F, rows.seen), np.eye(4)) if rows.tool_known else _hand_eye(F, rows.seen)
    start = np.array([base @ nominal[0], *nominal[1:-1], nominal[-1] @ tool])
    prior = Prior(base=UNKNOWN, links=KNOWN, tool=_tool_prior(rows))
    start = _identified(start, rows, prior, LEAST_NOISE)[0].placements
    apart = np.median(_errors(frames_of(start, rows.q)[-1], rows.seen)[0])
    if apart > FITS[0]:
        raise InputError(
            f"the rows of {pairs.source} do not fit {name}: {millimetres(float(apart))} mm are left with the best "
            "base and tool; are the joints in another order, or of another sign?"
        )
    fit = _fit(start, rows, prior._replace(links=LINK), pairs)
    placements = fit.arm.placements
    base = placements[0] @ np.linalg.inv(nominal[0])
    tcp = pairs.only_tcp if rows.tool_known else np.linalg.inv(nominal[-1]) @ placements[-1]
    errors, missing = _judged(fit, joints)
    return Fitted(placements, (), tcp, not rows.tool_known, errors, missing, pairs.notes, base)


def _seen_from(p: Floats, seen: Floats) -> Floats:
    """The motion from points (m, 3) to what was seen of them (Kabsch)."""
    middle, other = p.mean(axis=0), seen.mean(axis=0)
    base = np.eye(4)
    base[:3, :3] = _nearest_rotation((seen - other).T @ (p - middle))
    base[:3, 3] = other - base[:3, :3] @ middle
    return base


def calibration_from(file: str | Path, model: str, *, repair: bool = False) -> Calibration:
    """Read a UR's calibration from a file that has it, or fit it to one that has rows.

    Raises:
        UnknownNameError: Unknown model.
        InputError: As `read_calibration` and `calibrate`; or the rows do not determine it.
    """
    check_known("UR model", model, UR_LENGTHS)
    path = PUBLISHED_CALIBRATIONS.get(str(file)) or check_path("file", file)
    content = read_bytes(path, "the calibration", most=2**28)
    if is_program(content) or is_calibration(content) or not looks_like_rows(content):
        return calibrations_in(content, path, repair=repair)(model)
    found = fitted_ur(model, pairs_of(content, path.name))
    if found.missing:
        raise InputError(f"{path.name} does not determine the calibration: {found.missing}")
    expected = millimetres(float(np.median(found.fit.expected)))
    note = f"the calibration is fitted to {found.fit.rows} rows of {path.name}; {expected} mm are expected to be left"
    calibration = calibration_of(found.placements, model, path)
    return replace(calibration, note="; ".join([note, *found.notes]))


def millimetres(length: float) -> str:
    return f"{1e3 * length:.3g}"

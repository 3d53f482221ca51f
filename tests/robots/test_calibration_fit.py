"""The steps of a calibration's fit, each on few rows of made-up robots: what is refused, put right, and left out."""

import re
from dataclasses import replace

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import pose, pose_vector
from kinreach.robots import _calibration_fit, calibrate
from kinreach.robots._calibration_fit import _Guess, _rows_of, calibration_from
from kinreach.robots._identification import IdentifiedArm
from kinreach.robots.inside import UR_LENGTHS, frames_of
from tests.robots.test_calibrate import (
    OFFSET,
    RTDE,
    TCP,
    WORKSPACE,
    made_up,
    nominal_placements,
    pairs_of,
    postures,
    table,
)

DIGITS = (1e-11, 1e-11)
#: A noise below which nothing is a change of the tool or the robot [m], [rad].
ROUGH = (1e-3, 1e-3)


def refused(function, *given, **options):
    with pytest.raises(InputError) as error:
        function(*given, **options)
    return str(error.value)


def numbers_after(word, said):
    return [float(number) for number in re.search(rf"{word} ([-\d.e,]+)", said)[1].split(",")]


def assert_same_arm(placements, true):
    """Its flange is the same in any posture; frames between joints may be anywhere on the axes."""
    found, flange = (frames_of(each, WORKSPACE)[-1] for each in (placements, true))
    np.testing.assert_allclose(found, flange, atol=3e-6)


def test_two_postures_or_a_still_arm_are_not_fitted():
    """Three postures, of which one joint moves by more than 0.02 rad, are."""
    pairs = pairs_of(nominal_placements("ur5e"), postures(3, 0))
    assert len(_calibration_fit._thinned(pairs)) == 3
    assert "has 2 different postures, whose joints differ" in refused(_calibration_fit._thinned, pairs.rows([0, 1, 1]))
    one = refused(_calibration_fit._thinned, pairs.rows([0, 0, 0]))
    assert "has 1 different posture, whose joints differ by 0 rad at most" in one
    q = np.tile(pairs.q[0], (5, 1))
    q[:, 2] += np.linspace(0.0, 0.021, 5)
    assert len(_calibration_fit._thinned(pairs_of(nominal_placements("ur5e"), q))) == 5
    q[:, 2] = np.linspace(0.0, 0.019, 5)
    said = refused(_calibration_fit._thinned, pairs_of(nominal_placements("ur5e"), q))
    assert "5 different postures, whose joints differ by 0.019 rad" in said


def test_a_named_model_is_fitted_if_it_is_about_as_near_as_the_best():
    """Rows of a UR5e fit it; not a UR10, whose data sheet is far off: both distances are said."""
    pairs = pairs_of(made_up("ur5e", 6), postures(8, 6))
    said = refused(_calibration_fit.fitted_ur, "ur10", pairs)
    assert "are those of a ur5e or ur7e, not of a ur10" in said
    near, far = map(float, re.search(r"are ([\d.]+) and ([\d.]+) mm off", said).groups())
    rows = _rows_of(pairs)
    F = {model: frames_of(nominal_placements(model), rows.q)[-1] for model in ("ur5e", "ur10")}
    for model, value in (("ur5e", near), ("ur10", far)):
        apart = np.linalg.norm((F[model] - rows.seen)[:, :3, 3], axis=1)
        turned = np.arccos(((np.swapaxes(F[model], 1, 2) @ rows.seen)[:, :3, :3].trace(axis1=1, axis2=2) - 1) / 2)
        assert value == pytest.approx(1e3 * np.median(np.hypot(apart, turned / 2)), rel=1e-2)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_the_other_of_two_near_models_may_be_named(factor, monkeypatch):
    """Up to three times the error of the best."""
    pairs = pairs_of(made_up("ur5e", 6), postures(8, 6))
    rows = _rows_of(pairs)
    guesses = [_Guess("ur10", rows, 1e-3, "other"), _Guess("ur5e", rows, 3e-3 * factor, "own")]
    monkeypatch.setattr(_calibration_fit, "_guesses", lambda rows, note="": guesses)
    if factor > 1:
        assert "those of a ur10, not of a ur5e" in refused(_calibration_fit.fitted_ur, "ur5e", pairs)
        return
    found = _calibration_fit.fitted_ur("ur5e", pairs)
    assert (found.models, found.notes) == (("ur5e",), ("own",))
    assert_same_arm(found.placements, made_up("ur5e", 6))


def test_the_model_that_deviates_least_is_taken(monkeypatch):
    """Where the data sheets alone do not decide: rows of a UR5e, and a UR10 that seems nearer."""
    true = made_up("ur5e", 6)
    pairs = pairs_of(true, postures(8, 6))
    rows = _rows_of(pairs)
    guesses = [_Guess("ur10", rows, 1.0e-3, ""), _Guess("ur5e", rows, 1.1e-3, "")]
    monkeypatch.setattr(_calibration_fit, "_guesses", lambda rows, note="": guesses)
    found = _calibration_fit.fitted_ur(None, pairs)
    assert found.models == ("ur5e", "ur7e")
    assert_same_arm(found.placements, true)


def test_rows_in_base_link_or_with_joints_in_another_order_are_put_right(monkeypatch):
    monkeypatch.setattr(_calibration_fit, "_MODELS", ("ur3", "ur5e", "ur10"))
    pairs = pairs_of(made_up("ur5e", 5), postures(8, 5))
    flipped = replace(pairs, seen=np.diag([-1.0, -1.0, 1.0, 1.0]) @ pairs.seen)
    reversed_, swapped = pairs.q[:, ::-1], pairs.q[:, [0, 1, 2, 3, 5, 4]]
    put_right = 0
    for wrong, note in (
        (flipped, "base_link, as ROS has it"),
        (replace(pairs, q=reversed_), "in the order wrist_3, wrist_2, wrist_1, elbow, shoulder_lift, shoulder_pan"),
        (replace(pairs, q=swapped), "in the order shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_3, wrist_2"),
    ):
        guesses = _calibration_fit._repaired(wrong, _rows_of(wrong))
        assert guesses[0].model == "ur5e"
        assert all(note in guess.note for guess in guesses)
        np.testing.assert_allclose(guesses[0].rows.q, pairs.q)
        np.testing.assert_allclose(guesses[0].rows.seen, _rows_of(pairs).seen, atol=1e-12)
        put_right += 1
    assert put_right == 3


def test_another_tool_than_the_given_one_is_named():
    """As found by the data sheet: a robot is some millimetres off that."""
    pairs = pairs_of(nominal_placements("ur5e"), postures(8, 6))
    wrong = pairs.with_tcp(pose([0, 0, 0.3, 0, 0, 0]))
    said = refused(_calibration_fit._repaired, wrong, _rows_of(wrong))
    assert "the tool centre point of made_up.csv is not the one of its rows: they fit a ur5e with the tool" in said
    np.testing.assert_allclose(numbers_after("with the tool", said[:-1].split(";")[0]), pose_vector(TCP), atol=1e-5)


@pytest.mark.parametrize("known", [True, False])
def test_the_frame_of_a_feature_is_named(known, monkeypatch):
    """The model that fits best says where the feature is; of rows that fit none nothing is said."""
    monkeypatch.setattr(_calibration_fit, "_MODELS", ("ur3", "ur5e", "ur10"))
    named = 0
    for seed in range(3):
        q = postures(8, seed)
        feature = pose(np.random.default_rng(seed).uniform(-0.5, 0.5, 6))
        pairs = pairs_of(nominal_placements("ur5e"), q, known=known)
        away = replace(pairs, seen=np.linalg.inv(feature) @ pairs.seen)
        said = _calibration_fit._in_feature(away, _rows_of(away))
        assert "they fit a ur5e whose base has the feature at" in said
        found = numbers_after("feature at", said)
        np.testing.assert_allclose(found, pose_vector(feature), atol=1e-5)
        torn = replace(away, q=q + np.random.default_rng(seed).normal(size=q.shape))
        assert _calibration_fit._in_feature(torn, _rows_of(torn)) == ""
        points = replace(away, seen=away.positions)
        assert _calibration_fit._in_feature(points, _rows_of(points)) == ""
        named += 1
    assert named == 3


def test_rows_in_a_feature_are_refused_with_its_frame(monkeypatch):
    monkeypatch.setattr(_calibration_fit, "_MODELS", ("ur5e", "ur10"))
    pairs = pairs_of(nominal_placements("ur5e"), postures(8, 3))
    away = replace(pairs, seen=pose([0.3, -0.2, 0.1, 0.0, 0.0, 0.7]) @ pairs.seen)
    said = refused(_calibration_fit._repaired, away, _rows_of(away))
    assert said == _calibration_fit._in_feature(away, _rows_of(away)) != ""


def test_rows_that_mostly_do_not_fit_are_refused(monkeypatch):
    """Six of sixteen rows may be dropped, seven may not: up to 40 percent."""
    true, dropped = made_up("ur5e", 3), []
    start, prior = _calibration_fit._ur_start(_Guess("ur5e", _rows_of(pairs_of(true, postures(16, 3))), 0.0, ""))
    for wrong in (6, 7):
        pairs = pairs_of(true, postures(16, 3))
        arm = IdentifiedArm(start, pairs.q, _rows_of(pairs).seen, prior=prior, noise=DIGITS, steps=5)
        seen = pairs.seen.copy()
        seen[:wrong, :3, 3] += np.random.default_rng(1).uniform(0.01, 0.02, (wrong, 3))
        pairs = replace(pairs, seen=seen)
        monkeypatch.setattr(_calibration_fit, "_identified", lambda *_, arm=arm: (arm, (1e-6, 1e-6)))
        monkeypatch.setattr(_calibration_fit, "_held_out", lambda start, rows, *_: np.zeros(len(rows.q)))
        if wrong == 6:
            fit = _calibration_fit._fit(start, _rows_of(pairs), prior, pairs)
            dropped = [place for place, _ in fit.dropped]
        else:
            said = refused(_calibration_fit._fit, start, _rows_of(pairs), prior, pairs)
            assert said.startswith("7 of 16 rows of made_up.csv do not fit the others")
    assert dropped == [f"line {row}" for row in range(2, 8)]


@pytest.mark.parametrize("count", [19, 20, 21, 27])
def test_every_row_is_judged_once_by_a_fit_to_the_others(count, monkeypatch):
    """Up to 20 rows each alone, more in ten parts."""
    fits, q = [], np.arange(count * 6.0).reshape(count, 6)
    seen = np.zeros((count, 3))

    class Arm:
        def __init__(self, rows):
            fits.append(rows.q[:, 0])

        def poses(self, q):
            T = np.tile(np.eye(4), (len(q), 1, 1))
            T[:, 0, 3], T[:, 1, 3] = len(fits), q[:, 0]
            return T

    monkeypatch.setattr(_calibration_fit, "_most_probable", lambda start, rows, prior, noise: Arm(rows))
    rows = _calibration_fit._Rows(q, seen, True)
    errors = _calibration_fit._held_out(np.eye(4)[None], rows, None, ROUGH)
    parts = count if count <= 20 else 10
    assert len(fits) == parts
    assert len(errors) == count
    for row, error in enumerate(errors):
        by = row % parts
        assert error == pytest.approx(np.hypot(by + 1, q[row, 0]))
        np.testing.assert_array_equal(fits[by], np.delete(q[:, 0], np.arange(by, count, parts)))


def test_rows_left_out_are_farther_off_than_those_of_the_fit():
    """With noise of 0.1 mm and as few rows as a robot has frames; compared with fits that are written out here."""
    true, farther = made_up("ur5e", 4), 0
    for seed in range(2):
        pairs = pairs_of(true, postures(8, seed), noise=(1e-4, 1e-4), seed=seed)
        rows = _rows_of(pairs)
        start, prior = _calibration_fit._ur_start(_Guess("ur5e", rows, 0.0, ""))
        errors = _calibration_fit._held_out(start, rows, prior, (1e-4, 1e-4))
        for row in (0, 5):
            others = np.delete(np.arange(8), row)
            arm = IdentifiedArm(start, rows.q[others], rows.seen[others], prior=prior, noise=(1e-4, 1e-4), steps=5)
            apart = arm.poses(rows.q[[row]])[0, :3, 3] - rows.seen[row, :3, 3]
            assert errors[row] == pytest.approx(np.linalg.norm(apart), rel=1e-6)
        arm = IdentifiedArm(start, rows.q, rows.seen, prior=prior, noise=(1e-4, 1e-4), steps=5)
        inside = np.linalg.norm((arm.poses(rows.q) - rows.seen)[:, :3, 3], axis=1)
        farther += np.median(errors) > 1.5 * np.median(inside)
    assert farther == 2


def judged_for_two(pairs, noise):
    rows = _rows_of(pairs)
    start, prior = _calibration_fit._ur_start(_Guess("ur5e", rows, 0.0, ""))
    return _calibration_fit._refuse_two(start, rows, prior, pairs, noise, DIGITS)


@pytest.mark.parametrize("known", [True, False])
def test_rows_of_two_tools_are_refused_with_the_change(known, monkeypatch):
    """The message names the row at which the tool changes: the middle, as nothing else is tried here."""
    monkeypatch.setattr(_calibration_fit, "sorted", lambda rows, key: [8], raising=False)
    first, change = made_up("ur5e", 6), pose([0.0, 0.0, 0.003, 0.0, 0.0, 0.005])
    one = pairs_of(first, postures(8, 6), known=known)
    two = pairs_of(first, postures(8, 8), tool=TCP @ change, known=known)
    two = replace(two, source="two.csv", tcp=one.tcp)
    said = refused(judged_for_two, one.joined(two), (1e-3, 1e-3))
    assert "the tool changes in made_up.csv, two.csv near line 2 of two.csv, by " in said
    expected = change if not known else TCP @ change @ np.linalg.inv(TCP)
    np.testing.assert_allclose(numbers_after(", by", said[: said.index(": give")]), pose_vector(expected), atol=1e-4)


def test_rows_of_two_robots_are_refused(monkeypatch):
    """From eight of sixteen rows on; fewer rows are not judged, nor those with little noise or a good whole."""
    monkeypatch.setattr(_calibration_fit, "sorted", lambda rows, key: [8], raising=False)
    one = pairs_of(made_up("ur5e", 6), postures(8, 6))
    two = replace(pairs_of(made_up("ur5e", 7), postures(8, 7)), source="two.csv")
    both = one.joined(two)
    said = refused(judged_for_two, both, (1e-3, 1e-3))
    assert said == (
        "made_up.csv, two.csv has the rows of two robots or tools, one up to line 2 of two.csv: give those of one"
    )
    points = replace(both, seen=both.positions, tcp=None)
    assert "two robots or tools, one up to line 2 of two.csv" in refused(judged_for_two, points, (1e-3, 1e-3))
    assert judged_for_two(both, (2.9e-6, 1e-3)) is None
    assert judged_for_two(both.rows(range(1, 16)), (1e-3, 1e-3)) is None


@pytest.mark.parametrize(("noise", "two"), [(3.9e-4, False), (4.1e-4, True)])
def test_two_parts_are_two_robots_if_each_has_a_quarter_of_the_noise(noise, two, monkeypatch):
    """Parts that mix both, before and after the ninth of 20 rows, have more; every tenth from 0.2 to 0.8 is tried."""
    q, parts = np.arange(20.0)[:, None] * np.ones(6), []

    class Arm:
        placements = nominal_placements("ur5e")

        def poses(self, q):
            return np.tile(np.eye(4), (len(q), 1, 1))

    def identified(start, rows, prior, least):
        low, high = rows.q[[0, -1], 0]
        parts.append((low, high))
        return Arm(), (3e-4 if low < 8 <= high else 1e-4, 1e-4)

    monkeypatch.setattr(_calibration_fit, "_identified", identified)
    pairs = pairs_of(Arm.placements, q)
    if two:
        assert "one up to line 10" in refused(judged_for_two, pairs, (noise, 1e-3))
    else:
        assert judged_for_two(pairs, (noise, 1e-3)) is None
    assert parts[:2] == [(0, 9), (10, 19)]
    assert sorted(parts) == sorted([part for row in range(4, 17, 2) for part in ((0, row - 1), (row, 19))])
    parts.clear()
    judged_for_two(pairs, (1.9e-4, 1e-3))  # the better half has more than half the noise of all rows
    assert parts == [(0, 9), (10, 19)]


@pytest.mark.parametrize(
    ("count", "still", "expected", "remedy"),
    [
        (5, (), 6e-4, "add rows: 5 are too few, six or more are needed"),
        (6, (), 6e-4, "add rows all over the workspace, or rows with more digits"),
        (6, (2,), 6e-4, "add rows in which elbow turns by 1 rad or more"),
        (6, (2, 4), 6e-4, "add rows in which elbow and wrist_2 turn by 1 rad or more"),
        (6, (2, 4), 4e-4, None),
    ],
)
def test_what_is_missing_is_said_with_the_remedy(count, still, expected, remedy):
    """Where more than half of a correction of 1 mm would be left."""
    q = np.linspace(0.0, 0.31, count)[:, None] * np.ones(6)
    q[:, still] *= 0.29 / 0.31
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    said = _calibration_fit._missing(_calibration_fit._Rows(q, np.zeros((count, 3)), True), names, expected, 1e-3)
    left = f"the rows leave {1e3 * expected:g} mm over the workspace, where they correct the data sheet by 1 mm: "
    assert said == ("" if remedy is None else left + remedy)


def test_a_table_of_rows_is_a_calibration(tmp_path, monkeypatch):
    """The note says on how many rows it rests and what they leave; rows that do not determine it are refused."""
    true, q = made_up("ur5e", 3), postures(8, 3)
    file = tmp_path / "rows.csv"
    file.write_text(table(q, frames_of(true, q)[-1] @ TCP, [*RTDE, *OFFSET], degrees=True, tcp=TCP))
    found = calibration_from(file, "ur5e")
    assert found.model == "ur5e"
    assert_same_arm(found.placements, true)
    note, units = found.note.split("; the joint angles")
    match = re.fullmatch(r"the calibration is fitted to 8 rows of rows.csv; (.*) mm are expected to be left", note)
    assert 0 < float(match[1]) < 1e-3
    assert units == " of rows.csv are larger than radians can be: read as degrees"
    monkeypatch.setattr(_calibration_fit, "_missing", lambda *_: "add rows")
    said = refused(calibration_from, file, "ur5e")
    assert said == "rows.csv does not determine the calibration: add rows"


def test_differences_from_a_data_sheet_that_is_not_named_are_refused(tmp_path):
    """Whichever it is, small ones fit; with arm= they are those of that robot, here by its own data sheet."""
    rows = [f"{name} = [ {', '.join(['0.0'] * 6)} ]" for name in ("delta_theta", "delta_a", "delta_d", "delta_alpha")]
    file = tmp_path / "calibration.conf"
    file.write_text("\n".join(["[mounting]", *rows, ""]))
    said = refused(calibrate, file)
    assert said.startswith("calibration.conf says how far a robot is off its data sheet, but not which robot it is: ")
    assert all(model in said for model in UR_LENGTHS)
    assert said.endswith("; name yours with arm=")
    for model in ("ur3", "ur10e"):
        result = calibrate(file, arm=model)
        assert result.models == (model,)
        assert_same_arm(result.calibration.placements, nominal_placements(model))

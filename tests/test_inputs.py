"""Checks of single numbers: what is a number, what is an integer, and their bounds."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from kinreach._checks import check_count, check_flag, check_number, printable, shown
from kinreach.errors import InputError, PathError, UnknownNameError, raise_unknown
from kinreach.kinematics import CollisionChecker, UR5Kinematics
from kinreach.sim import ArmSimulation
from kinreach.vision import Intrinsics, SensorNoise

NO_NUMBERS = [True, False, np.True_, np.False_, np.array(True), None, "1", 1j, [1.0], Decimal(1), np.array([1.0])]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize("check", [check_number, check_count])
def test_truth_values_and_other_things_are_no_numbers(check, value):
    with pytest.raises(InputError, match=r"it must be an? (number|integer), got "):
        check("it", value, least=0)


@pytest.mark.parametrize(
    "value", [1, 1.0, np.float32(1), np.float64(1), np.int8(1), np.uint64(1), Fraction(1)], ids=repr
)
def test_numbers_of_any_type(value):
    assert check_number("it", value) == 1.0
    assert type(check_number("it", value, least=1.0, most=1.0)) is float


@pytest.mark.parametrize("yes", [True, np.True_], ids=repr)
@pytest.mark.parametrize(
    "use",
    [
        lambda yes: ArmSimulation("arm3", tolerance=yes),
        lambda yes: CollisionChecker("arm3", margin=yes),
        lambda yes: SensorNoise(rgb_sigma=yes),
        lambda yes: Intrinsics.from_fovy(yes, 640, 480),
        lambda yes: UR5Kinematics().batch(np.eye(4)[None], tol=yes),
    ],
)
def test_nothing_takes_a_truth_value_for_a_number(use, yes):
    with pytest.raises(InputError, match="must be a number, got"):
        use(yes)


def test_unknown_names_are_cut_and_guessed():
    def refused(name, available):
        with pytest.raises(UnknownNameError) as error:
            raise_unknown("thing", name, available)
        return str(error.value)

    assert refused("Panada", ["ur5", "panda"]) == "unknown thing 'Panada'; available: panda, ur5; did you mean panda?"
    ranked = refused("single", ["ppo-single", "singles", "ranked-single"])
    assert ranked.endswith("available: ppo-single, ranked-single, singles; did you mean ppo-single or ranked-single?")
    assert refused("x", ["b", "a"]) == "unknown thing 'x'; available: a, b"
    long = "panda" * 20
    assert refused(long, [long[:-1] + "x"]).startswith(f"unknown thing {long!r};")
    assert refused(f"{long}y", [long]) == f"unknown thing '{long}…'; available: {long}"


def test_texts_of_values_are_short_whatever_they_are():
    class Hostile:
        def __repr__(self):
            raise ValueError

    assert shown(3) == "3"
    assert len(shown("x" * 1000)) == len(shown(10**100)) == 60
    assert shown(Hostile()).startswith("<Hostile instance at") or shown(Hostile()) == "an object of type Hostile"
    endless = []
    endless.append(endless)
    for value in (10**9999, "x" * 10**6, [0] * 10**6, endless, b"\xff" * 999, {i: i for i in range(999)}):
        assert 0 < len(shown(value)) < 300
    assert printable("a\tb\n\x1b\N{SNOWMAN}") == "a\tb\n\\x1b\N{SNOWMAN}"


def test_counts_and_numbers_are_within_their_bounds():
    assert [check_count("it", value, most=3) for value in (1, 3)] == [1, 3]
    for value, said in ((0, "at least 1, got 0"), (4, "at most 3, got 4")):
        with pytest.raises(InputError, match=f"^it must be {said}$"):
            check_count("it", value, most=3)
    assert [check_number("it", value, least=1, most=2) for value in (1, 2)] == [1, 2]
    for bounds, value, said in (
        ({"least": 1}, 0.5, "finite and at least 1"), ({"above": 0}, 0.0, "finite and above 0"),
        ({"least": 1, "most": 2}, 3, "finite and at least 1 and at most 2"), ({}, float("inf"), "finite"),
        ({}, 10**400, "finite"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"^it must be {said}, got"):
            check_number("it", value, **bounds)


def test_flags_are_true_or_false():
    for value in (True, np.False_):
        check_flag("it", value)
    for value in (0, 1, "yes", None, np.array([True])):
        with pytest.raises(InputError, match=r"^it must be true or false, got"):
            check_flag("it", value)


def test_a_path_that_fails_without_a_place_has_none():
    error = PathError("blocked")
    assert (error.index, error.fraction, error.q, error.branches, error.starts) == (-1, 0.0, None, (), ())
    assert PathError("blocked", index=2, fraction=0.5, q=[1.0], branches=(3,), starts=[[0.0]]).args == ("blocked",)

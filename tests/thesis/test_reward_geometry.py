"""The thesis's reward: hand-worked values, exact sums, one function for one posture and for many, and geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.thesis import distance_reward, pentagon_angles, posture_error, reach_reward

PI = math.pi
#: Tool straight down in a natural posture, on either branch.
DOWN_A = np.array([-PI / 2, -PI / 2, PI / 2, -PI / 2, -PI / 2, 0.0])
DOWN_B = np.array([PI / 2, -PI / 2, -PI / 2, -PI / 2, PI / 2, 0.0])


def natural_arm_error(q):
    return -reach_reward(1.0, q).terms.natural_arm


def gripper_angle_error(q):
    return -reach_reward(1.0, q).terms.gripper_angle


FUNCTIONS = (natural_arm_error, gripper_angle_error, posture_error, lambda q: pentagon_angles(q).delta)


def random_postures(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-PI, PI, (count, 6))


def near_solutions(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Postures that are almost natural and perpendicular on both branches, and distances around 0.01 m."""
    rng = np.random.default_rng(seed)
    q = np.where(rng.random((count, 1)) < 0.5, DOWN_A, DOWN_B)
    return q + rng.normal(0.0, 0.05, (count, 6)), rng.uniform(0.0, 0.02, count)


class TestDistanceReward:
    @pytest.mark.parametrize(
        ("d", "expected"),
        [(2.0, 0.0), (1.0, 0.5), (0.5, 1.0), (0.25, 1.5), (4.0, -1.0), (3.0, -0.5), (0.125, 2.0), (2.0**-20, 10.5)],
    )
    def test_hand_worked(self, d, expected):
        assert distance_reward(d) == expected

    def test_touching(self):
        assert distance_reward(0.01) == pytest.approx(3.821928094887362, abs=1e-14)

    def test_limit_at_zero(self):
        assert distance_reward(0.0) == math.inf
        assert distance_reward([0.0, 1.0]).tolist() == [math.inf, 0.5]

    def test_branches_meet(self):
        below, above = math.nextafter(2.0, 0.0), math.nextafter(2.0, 3.0)
        assert 0.0 <= distance_reward(below) < 1e-15
        assert -1e-15 < distance_reward(above) <= 0.0

    def test_falls_with_distance(self):
        d = np.sort(np.concatenate([np.geomspace(1e-12, 2.0, 20_000), np.linspace(2.0, 10.0, 20_000)[1:]]))
        assert np.all(np.diff(distance_reward(d)) < 0.0)

    @pytest.mark.parametrize("d", [-1e-9, math.nan, math.inf, -math.inf, [0.1, -0.1], [0.1, math.nan], "far", None])
    def test_refused(self, d):
        with pytest.raises(InputError, match=r"^d must be"):
            distance_reward(d)


class TestNaturalArm:
    @pytest.mark.parametrize(
        ("j0", "j2", "j4", "expected"),
        [
            (-1.0, 1.0, -PI / 2, 0.0),  # branch A
            (-1.0, 1.0, PI / 2, PI),
            (-1.0, 1.0, 0.0, PI / 2),
            (1.0, -1.0, PI / 2, 0.0),  # branch B
            (1.0, -1.0, -PI / 2, PI),
            (1.0, -1.0, PI, PI / 2),
            (1.0, 1.0, -PI / 2, 25.0),  # neither
            (-1.0, -1.0, PI / 2, 25.0),
            (1e-300, 1e-300, -PI / 2, 25.0),  # the product of the two would be 0
            (0.0, 1.0, -PI / 2, 0.0),  # on the border of one branch
            (0.0, -1.0, PI / 2, 0.0),
            (-1.0, 0.0, -PI / 2, 0.0),
            (1.0, 0.0, PI / 2, 0.0),
            (-0.0, 1.0, -PI / 2, 0.0),
            (1.0, -0.0, PI / 2, 0.0),
        ],
    )
    def test_hand_worked(self, j0, j2, j4, expected):
        assert natural_arm_error([j0, 0.3, j2, -0.7, j4, 2.0]) == expected

    def test_both_branches_hold_at_zero(self):
        """The branch with the smaller r_e counts, for both of its parts."""
        a = np.array([0.0, -PI / 2, 0.0, 0.0, -PI / 2, 0.0])
        b = np.array([0.0, -PI / 2, 0.0, -PI, PI / 2, 0.0])
        assert posture_error(a) == 0.0
        assert posture_error(b) == pytest.approx(0.0, abs=1e-15)
        for q in random_postures(1, 1000) * (0, 1, 0, 1, 1, 1):
            sides = q + np.array([[-1e-9, 0, 0, 0, 0, 0], [1e-9, 0, 0, 0, 0, 0]])
            parts = list(zip(natural_arm_error(sides), gripper_angle_error(sides), strict=True))
            chosen = (natural_arm_error(q), gripper_angle_error(q))
            assert chosen == min(parts, key=sum)
            assert posture_error(q) == min(posture_error(sides))


class TestPentagon:
    def test_hand_worked_on_a(self):
        angles = pentagon_angles([-0.5, -1.0, 1.2, -0.4, 0.0, 0.0])
        assert angles[:3] == pytest.approx((1.0, 1.2, 0.4), abs=1e-15)
        assert angles.delta == pytest.approx(2 * PI - 0.4 - (PI - 1.2) - 1.0, abs=1e-15)
        assert gripper_angle_error([-0.5, -1.0, 1.2, -0.4, 0.0, 0.0]) == pytest.approx(PI / 2 - 0.2, abs=1e-15)

    def test_hand_worked_on_b(self):
        angles = pentagon_angles([0.5, -2.0, -1.2, -1.0, 0.0, 0.0])
        assert angles[:3] == pytest.approx((PI - 2.0, 1.2, PI - 1.0), abs=1e-15)
        assert angles.delta == pytest.approx(4.2 - PI, abs=1e-15)
        assert gripper_angle_error([0.5, -2.0, -1.2, -1.0, 0.0, 0.0]) == pytest.approx(1.5 * PI - 4.2, abs=1e-14)

    @pytest.mark.parametrize("q", [DOWN_A, DOWN_B])
    def test_perpendicular(self, q):
        assert pentagon_angles(q).delta == pytest.approx(PI / 2, abs=1e-15)
        assert posture_error(q) == pytest.approx(0.0, abs=1e-15)

    def test_angles_of_a_pentagon_sum_to_three_pi(self):
        alpha, beta, gamma, delta = pentagon_angles(random_postures(2, 10_000))
        assert delta + PI / 2 + PI / 2 + gamma + (PI - beta) + alpha == pytest.approx(3 * PI, abs=1e-13)

    def test_is_the_sum_of_the_joints(self):
        q = random_postures(3, 10_000)
        on_a = q[:, 2] > 0.0  # also where neither branch holds: the elbow's sign names the branch
        lift = q[:, 1] + q[:, 2] + q[:, 3]
        expected = np.abs(np.where(on_a, lift + PI / 2, lift + 3 * PI / 2))
        assert gripper_angle_error(q) == pytest.approx(expected, abs=1e-13)
        neither = natural_arm_error(q) == 25.0
        assert np.count_nonzero(neither & on_a) > 2000
        assert np.count_nonzero(neither & ~on_a) > 2000

    @pytest.mark.parametrize(("j0", "j2", "j4"), [(-1, 1, -PI / 2), (1, -1, PI / 2)], ids=["branch A", "branch B"])
    def test_error_is_the_tilt_of_the_tool(self, j0, j2, j4):
        """With wrist_2 at the branch's right angle the tool axis stays in the arm's plane; delta tells its tilt."""
        q = random_postures(4, 2000)
        q[:, 0] = j0 * np.abs(q[:, 0])
        q[:, 2] = j2 * np.abs(q[:, 2])
        q[:, 4] = j4
        kin = ArmKinematics("ur5", tip="tool0")
        axis = kin.fk(q)[:, :3, 2]
        tilt = np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), -axis[:, 2])
        turns = np.remainder(gripper_angle_error(q) + PI, 2 * PI) - PI
        assert np.abs(turns) == pytest.approx(tilt, abs=1e-9)
        assert natural_arm_error(q).max() == 0.0

        q[:, 3] += j0 * (pentagon_angles(q).delta - PI / 2)  # now perpendicular
        down = kin.fk(q)[:, :3, 2]
        assert pentagon_angles(q).delta == pytest.approx(PI / 2, abs=1e-13)
        assert down == pytest.approx(np.tile((0.0, 0.0, -1.0), (2000, 1)), abs=1e-9)

    def test_a_whole_turn_is_an_error(self):
        """Nothing is wrapped: the tool points down, a turn later."""
        q = np.array([-1.0, PI / 2, PI / 2, PI / 2, -PI / 2, 0.0])
        assert ArmKinematics("ur5", tip="tool0").fk(q)[:3, 2] == pytest.approx((0, 0, -1), abs=1e-9)
        assert gripper_angle_error(q) == pytest.approx(2 * PI, abs=1e-14)


class TestReachReward:
    @pytest.mark.parametrize(
        ("d", "lean", "reward", "reached"),
        [
            (0.0, 0.0, 20.0, True),
            (0.0099, 0.14, 20.0, True),
            (0.005, 0.2, 10.0 - 0.2, False),
            (0.0, 1.0, 9.0, False),
            (0.01, 0.0, 3.821928094887362, False),  # not below 0.01
            (1.0, 0.0, 0.5, False),
            (2.0, 0.25, -0.25, False),
            (4.0, 0.5, -1.5, False),
        ],
    )
    @pytest.mark.parametrize("down", [DOWN_A, DOWN_B], ids=["branch A", "branch B"])
    def test_hand_worked(self, d, lean, reward, reached, down):
        result = reach_reward(d, down + np.array([0, 0, 0, lean, 0, 0]))
        assert result.reward == pytest.approx(reward, abs=1e-14)
        assert result.posture_error == pytest.approx(lean, abs=1e-14)
        assert bool(result.reached) is reached

    def test_unnatural(self):
        q = np.array([1.0, -PI / 2, PI / 2, -PI / 2, -PI / 2, 0.0])
        assert reach_reward(1.0, q).reward == 0.5 - 25.0
        assert reach_reward(0.0, q).reward == 10.0 - 25.0

    def test_impossible_comes_first(self):
        result = reach_reward(0.0, DOWN_A, impossible=True)
        assert result.reward == -100.0
        assert result.terms == (0.0, 0.0, 0.0, -100.0)
        assert not result.reached
        assert result.posture_error == posture_error(DOWN_A)

    def test_around_the_boundary(self):
        q = np.tile(DOWN_A, (201, 1))
        q[:, 4] = -PI / 2 - 0.15 + np.spacing(PI / 2) * np.arange(-100, 101)
        result = reach_reward(0.005, q)
        below = posture_error(q) < 0.15
        assert 90 < np.count_nonzero(below) < 110
        assert np.array_equal(result.reached, below)
        assert np.array_equal(result.reward, np.where(below, 20.0, 10.0 - posture_error(q)))

    def test_terms_of_special_cases(self):
        q = DOWN_A + np.array([0, 0, 0, 0.25, 0.5, 0])
        terms = reach_reward(0.001, q).terms
        assert terms.distance == 0.0
        assert terms.special == 10.0
        assert (terms.natural_arm, terms.gripper_angle) == pytest.approx((-0.5, -0.25), abs=1e-15)
        assert reach_reward(0.001, DOWN_A).terms == (0.0, 0.0, 0.0, 20.0)
        assert reach_reward(0.5, q).terms.special == 0.0
        assert list(terms._asdict()) == ["natural_arm", "gripper_angle", "distance", "special"]

    @pytest.mark.parametrize("kind", ["random", "near a solution", "impossible"])
    def test_terms_sum_to_the_reward_exactly(self, kind):
        count = 20_000
        if kind == "near a solution":
            q, d = near_solutions(5, count)
        else:
            q, d = random_postures(6, count), np.random.default_rng(7).uniform(0.0, 3.0, count)
        impossible = np.random.default_rng(8).random(count) < 0.5 if kind == "impossible" else False
        result = reach_reward(d, q, impossible=impossible)
        assert np.array_equal(sum(result.terms), result.reward)

        plain = distance_reward(d) - posture_error(q)
        plain = np.where(d < 0.01, 10.0 - posture_error(q), plain)
        plain = np.where((d < 0.01) & (posture_error(q) < 0.15), 20.0, plain)
        plain = np.where(impossible, -100.0, plain)
        assert np.array_equal(result.reward, plain)
        assert np.array_equal(result.reached, plain == 20.0)
        if kind == "near a solution":
            assert np.count_nonzero(result.reached) > 2000
            assert np.count_nonzero((d < 0.01) & ~result.reached) > 500
            assert np.count_nonzero(d >= 0.01) > 5000

    def test_one_posture_is_one_row_of_many(self):
        q, d = near_solutions(9, 300)
        q = np.concatenate([q, random_postures(10, 300), random_postures(11, 100) * (0, 1, 0, 1, 1, 1)])
        d = np.concatenate([d, np.random.default_rng(12).uniform(0.0, 3.0, 400)])
        impossible = np.random.default_rng(13).random(len(d)) < 0.1
        many = reach_reward(d, q, impossible=impossible)
        batched = [function(q) for function in FUNCTIONS]
        for i in range(len(d)):
            one = reach_reward(float(d[i]), q[i].tolist(), impossible=bool(impossible[i]))
            assert one.reward == many.reward[i]
            assert one.posture_error == many.posture_error[i]
            assert one.reached == many.reached[i]
            assert one.terms == tuple(term[i] for term in many.terms)
            assert sum(one.terms) == one.reward
            assert [function(q[i]) for function in FUNCTIONS] == [values[i] for values in batched]
        assert len(d) >= 700

    def test_leading_dimensions(self):
        q, d = random_postures(14, 24).reshape(2, 3, 4, 6), np.linspace(0.1, 3.0, 4)
        result = reach_reward(d, q, impossible=np.zeros((3, 1), dtype=bool))
        for value in (result.reward, result.posture_error, result.reached, *result.terms):
            assert value.shape == (2, 3, 4)
        assert result.reward[1, 2, 3] == reach_reward(d[3], q[1, 2, 3]).reward
        many_distances = reach_reward(d, DOWN_A)
        assert many_distances.posture_error.shape == many_distances.reward.shape == (4,)
        assert reach_reward(np.empty(0), np.empty((0, 6))).reward.shape == (0,)

    def test_falls_with_distance(self):
        d = np.concatenate([np.geomspace(1e-6, 0.00999, 100), np.geomspace(0.01, 10.0, 5000)])
        reward = reach_reward(d, DOWN_A).reward
        assert set(reward[:100]) == {20.0}
        assert np.all(np.diff(reward[100:]) < 0.0)


class TestInput:
    @pytest.mark.parametrize("function", [*FUNCTIONS, lambda q: reach_reward(1.0, q)])
    @pytest.mark.parametrize("q", [0.0, [0.0] * 5, [0.0] * 7, np.zeros((6, 5)), np.zeros(0)])
    def test_wrong_shape(self, function, q):
        with pytest.raises(InputError, match=r"q must have shape \(\.\.\., 6\), got \("):
            function(q)

    @pytest.mark.parametrize("function", [*FUNCTIONS, lambda q: reach_reward(1.0, q)])
    @pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
    @pytest.mark.parametrize("joint", [0, 5])
    def test_not_finite(self, function, bad, joint):
        one = np.zeros(6)
        one[joint] = bad
        for q in (one, np.stack([np.zeros(6), one])):
            with pytest.raises(InputError, match=r"q must be finite, got \["):
                function(q)

    def test_not_numbers(self):
        with pytest.raises(InputError, match="q must be an array of numbers"):
            posture_error(["a"] * 6)

    @pytest.mark.parametrize("d", [-0.1, math.nan, math.inf])
    def test_distance(self, d):
        with pytest.raises(InputError, match="d must be finite and not negative, got"):
            reach_reward(d, DOWN_A)

    def test_shapes_that_do_not_fit(self):
        with pytest.raises(InputError, match=r"d \(3,\), q \(2, 6\), impossible \(\)"):
            reach_reward(np.ones(3), np.zeros((2, 6)))

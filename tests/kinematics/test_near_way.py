"""The near way: no joint turns farther than it has to, over all postures of a goal and their detours."""

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.ik_arms.arms import urdf
from benchmarks.ik_arms.random_arms import OTHERS, some_arm
from kinreach.errors import InputError, PathError
from kinreach.kinematics import ArmKinematics, CollisionChecker, SixAxisKinematics, URKinematics, joint_line, plan_path
from kinreach.kinematics.inside import postures_of
from kinreach.robots import Box
from tests.cases import slow

MARGIN = 0.005


@pytest.fixture(scope="module")
def kin():
    return URKinematics("ur5e", base="world")


def travel(path):
    return np.abs(np.diff(path, axis=0)).sum(axis=0).max()


def clutter(kin, seed):
    """Boxes on the table, a free start posture, and a pose with the tool down that has a free posture."""
    rng = np.random.default_rng([7, seed])
    while True:
        sizes = rng.uniform((0.04, 0.04, 0.1), (0.1, 0.1, 0.4), (8, 3))
        places = np.column_stack([rng.uniform((0.25, -0.4), (0.65, 0.4), (8, 2)), sizes[:, 2] / 2.0])
        around = [
            Box(f"box {i}", tuple(size), tuple(at)) for i, (size, at) in enumerate(zip(sizes, places, strict=True))
        ]
        checker = CollisionChecker(kin, obstacles=[*kin.arm.workcell.obstacles, *around], margin=MARGIN)
        T = np.diag([1.0, -1.0, -1.0, 1.0])
        T[:3, 3] = rng.uniform((0.3, -0.35, 0.1), (0.6, 0.35, 0.3))
        goals, start = kin.all_solutions(T, seed=kin.arm.home), np.array(kin.arm.home)
        if checker.free(start) and any(checker.free(q) for q in goals.q):
            return checker, start, T


def alone(checker, start, goals):
    """The least travel of planning to each posture alone; those that are farther away cannot have less."""
    best = np.inf
    for goal in sorted(goals, key=lambda q: np.abs(q - start).max()):
        if checker.free(goal) and np.abs(goal - start).max() < best:
            try:
                best = min(best, travel(plan_path(checker, start, goal, timeout=20.0)))
            except PathError:
                continue
    return best


@pytest.mark.parametrize("count", [24, *slow(150)])
def test_no_other_posture_has_a_much_shorter_way(kin, count):
    detours, passed_over = 0, 0
    for seed in range(count):
        checker, start, T = clutter(kin, seed)
        path = plan_path(checker, start, kin.all_solutions(T), timeout=20.0)
        np.testing.assert_allclose(kin.fk(path[-1]), T, rtol=0, atol=1e-9)
        assert (joint_line(checker, path) == path).all()
        goals = kin.all_solutions(T, seed=start).q
        assert travel(path) <= 1.2 * alone(checker, start, goals)
        detours += len(path) > 2
        assert all(np.abs(b - a).max() > 0.01 for a, b in pairwise(path)), "a robot would stop twice at one place"
        straight = [q for q in goals if checker.free(q) and _is_free(checker, start, q)]
        passed_over += len(path) > 2 and len(straight) > 0
    assert detours >= count / 8
    assert passed_over >= count / 24, "a detour to a near posture is taken before a straight line to a farther one"


def _is_free(checker, start, goal):
    try:
        joint_line(checker, [start, goal])
    except PathError:
        return False
    return True


@pytest.mark.slow
def test_a_branch_is_chosen_by_number_by_words_and_as_it_is(kin):
    chosen = 0
    for seed in range(12):
        checker, start, T = clutter(kin, seed)
        solutions = kin.all_solutions(T)
        for branch in (2, 6, "left", "right, up", "up  STRAIGHT", "same"):
            try:
                end = plan_path(checker, start, solutions, branch=branch, timeout=20.0)[-1]
            except (PathError, InputError):
                continue
            off = np.abs(np.angle(np.exp(1j * (solutions.q - end)))).max(axis=1)
            assert off.min() < 1e-9
            index = int(solutions.branch[off.argmin()])
            if branch == "same":
                assert index == 6
                assert kin.branch_words(index) == ("right", "up", "straight")
            elif isinstance(branch, int):
                assert index == branch
            else:
                assert set(branch.lower().replace(",", " ").split()) <= set(kin.branch_words(index))
            chosen += 1
    assert chosen > 40


@pytest.mark.parametrize(
    ("branch", "reason"),
    [
        ("upp", "unknown word of a branch 'upp'.*did you mean up"),
        ("", "it is empty"),
        (9, "branch must be at most 7"),
        (-1, "branch must be at least 0"),
        (True, "branch must be an integer"),
        ("left, right", r"no posture of branch 'left, right'; it has 0 \(left, down, flipped\); 1 "),
    ],
)
def test_what_no_branch_is_called_is_refused(kin, branch, reason):
    checker, start, T = clutter(kin, 0)
    with pytest.raises(InputError, match=reason):
        plan_path(checker, start, kin.all_solutions(T), branch=branch)


def test_postures_and_arms_without_words_have_none(kin, tmp_path):
    checker, start, _ = clutter(kin, 0)
    with pytest.raises(InputError, match="postures are their own"):
        plan_path(checker, start, start[None], branch=0)
    with pytest.raises(InputError, match=f"{kin.arm.title} has no closed form, so its postures have no branches"):
        postures_of(ArmKinematics(kin.arm), kin.all_solutions(kin.fk(start)), 0, start)
    arm3 = ArmKinematics.of("arm3")
    home, goals = np.array(arm3.arm.home), arm3.all_solutions([0.3, 0.2, 0.3])
    with pytest.raises(InputError, match=r"the branches of .* have no names; give their number, or 'same'"):
        plan_path(CollisionChecker(arm3, margin=MARGIN), home, goals, branch="up")


def test_the_branch_of_an_arm_whose_branches_only_count_is_a_number(tmp_path):
    rng = np.random.default_rng(3)
    shapes = tmp_path / "general.urdf"
    chain = some_arm(rng, next(iter(OTHERS)))
    shapes.write_text(urdf(chain))
    kin = ArmKinematics.from_urdf(shapes)
    assert isinstance(kin, SixAxisKinematics)
    assert not kin.has_named_branches
    start = rng.uniform(-1.0, 1.0, 6)
    solutions = kin.all_solutions(kin.fk(start), limits=False)
    assert len(postures_of(kin, solutions, int(solutions.branch[0]), start)) == 1
    with pytest.raises(InputError, match="only count the postures of a pose; give their number"):
        postures_of(kin, solutions, "same", start)


def test_no_joint_turns_farther_than_is_allowed(kin):
    kept, refused = 0, 0
    for seed in range(16):
        checker, start, T = clutter(kin, seed)
        solutions = kin.all_solutions(T)
        free = plan_path(checker, start, solutions, timeout=20.0)
        path = plan_path(checker, start, solutions, timeout=20.0, max_travel=travel(free) + 1e-9)
        assert travel(path) <= travel(free) + 1e-9
        kept += 1
        nearest = min(np.abs(q - start).max() for q in kin.all_solutions(T, seed=start).q if checker.free(q))
        with pytest.raises(PathError, match=r"a joint would turn by [\d.]+ rad \(\d+°\) to the nearest of \d+ free"):
            plan_path(checker, start, solutions, max_travel=0.999 * nearest)
        refused += 1
    assert min(kept, refused) == 16
    with pytest.raises(InputError, match=r"max_travel \[rad\] must be"):
        plan_path(checker, start, solutions, max_travel=0.0)


def test_a_way_that_is_too_long_is_not_taken_for_one(kin):
    """A wall from the arm outwards and above its reach: the way to the other side is a turn around the back."""
    wall = Box("wall", (2.0, 0.02, 1.2), (1.2, 0.0, 0.6))
    checker = CollisionChecker(kin, obstacles=[*kin.arm.workcell.obstacles, wall], margin=MARGIN)
    rng, refused = np.random.default_rng(5), 0
    while refused < 3:
        T = np.diag([1.0, -1.0, -1.0, 1.0])
        T[:3, 3] = rng.uniform((0.4, 0.2, 0.15), (0.6, 0.35, 0.3))
        start = next((q for q in kin.all_solutions(T, seed=kin.arm.home).q if checker.free(q)), None)
        T[1, 3] *= -1.0
        goals = [] if start is None else [q for q in kin.all_solutions(T, seed=start).q if checker.free(q)]
        near = [q for q in goals if np.abs(q - start).max() < 1.5]
        if not near:
            continue
        with pytest.raises(PathError, match=r"no path was found within 0.2 s .* with a travel of 1.6 rad at most"):
            plan_path(checker, start, near, max_travel=1.6, timeout=0.2)
        refused += 1

"""The kinematics suites and the peers that they call: right answers first, then numbers in every cell."""

import builtins
import importlib
import sys
from collections import defaultdict

import numpy as np
import pytest

from benchmarks.speed.measure import Timings
from benchmarks.speed.peers import base
from benchmarks.speed.peers.analytic import ANALYTIC, WITH_APPROXIMATE
from benchmarks.speed.peers.base import IKPeer, installed, silent
from benchmarks.speed.poses import FLANGE, random_poses
from benchmarks.speed.sections import Options
from benchmarks.speed.suites import fk_batch, ik_batch, ik_calibrated, ik_edge_cases, ik_single, load_suite
from kinreach._rotations import pose_error
from kinreach.errors import InstallationError
from kinreach.kinematics import ArmKinematics

for module in ("eaik", "ik_geo", "ssik", "ur_analytic_ik"):
    pytest.importorskip(module)

QUICK = Options(rounds=1, quick=True, seed=3)
HOME = np.array(FLANGE.arm.home)
#: Peers that a suite names although they are installed, and why.
REFUSED = defaultdict(
    dict, {"ik-calibrated": {"EAIK": "Unknown Kinematic Class", ik_calibrated.SSIK: "takes minutes; not with --quick"}}
)
MODULES = {
    "pink": "pink", "mink": "mink", "ikpy": "ikpy", "roboticstoolbox": "roboticstoolbox",
    "OptIK": "optik", "TRAC-IK": "trac_ik",
}  # fmt: skip


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ik_single._makers(HOME))
def test_seeded_peers_reach(name):
    if name in MODULES:
        pytest.importorskip(MODULES[name], exc_type=ImportError)
    peer = ik_single._makers(HOME)[name]()
    solved = 0
    for pose in random_poses(np.random.default_rng(2), 15):
        for q in peer.solve(pose):
            assert q.shape == (6,)
            position, orientation = pose_error(pose, FLANGE.fk(q))
            assert position <= 1e-4 * (1 + 1e-6), name
            assert orientation <= 1e-3 * (1 + 1e-6), name
            assert FLANGE.within_limits(q, tolerance=1e-6)
            solved += 1
    assert solved >= 14


def test_the_nearest_branch_of_eaik_is_ours():
    peer = ik_single._makers(HOME)[ik_single.EAIK_NEAREST]()
    for pose in random_poses(np.random.default_rng(5), 50):
        (q,) = peer.solve(pose)
        assert q == pytest.approx(FLANGE.nearest(pose, HOME).q, abs=1e-6)


@pytest.mark.parametrize("name", ANALYTIC)
def test_analytic_peers_get_the_pose_in_their_own_frames(name):
    peer = ANALYTIC[name]()
    T = random_poses(np.random.default_rng(4), 20)
    with silent():
        for pose in T:
            q = peer.solve(pose)
            assert len(q) >= 2
            assert max(max(pose_error(pose, FLANGE.fk(x))) for x in q) < 1e-6
        if peer.batch is not None:
            assert len(peer.batch(T)()) == len(T)


@pytest.mark.parametrize("suite", ["ik-single", "ik-edge-cases", "ik-batch", "ik-calibrated", "ik-arms", "fk-batch"])
@pytest.mark.filterwarnings("ignore")
def test_suites(suite, monkeypatch, checked):
    for solver in ("placo", "kinreach, QP", "pink", "mink", "ikpy"):  # slow, and tested above
        monkeypatch.delitem(ik_single._SOLVERS, solver)
    told = []
    sections = checked(load_suite(suite)(QUICK, lambda *what: told.append(what)))
    assert told
    assert told[-1][1] == told[-1][2]
    for section in sections:
        assert f"--suite {suite}" in section.again
        assert all(np.isfinite(target.measured) for target in section.targets)
        assert set(section.missing) <= set(MODULES) | set(REFUSED[suite])
        assert all(len(values) == QUICK.rounds and min(values) > 0 for values in section.samples.values())
    assert any(section.targets for section in sections)
    named = {name: why for section in sections for name, why in section.missing.items()}
    assert all(why in named[name] for name, why in REFUSED[suite].items())


def test_the_text_of_single_poses_says_what_was_timed():
    timings = Timings()
    for name, us in ((ik_single.FORMULAS, 4.0), (ik_single.PUBLIC, 9.0), (ik_single.ARRAY, 15.0)):
        timings[name] = np.full((3, 5), 1e-6 * us) * [[1], [10], [1]]
    text = " ".join(ik_single._text(timings, 5).split())
    assert "5 poses of tool0" in text
    assert "it takes 2.25 times as long as the formulas" in text
    assert "takes 1.5 times as long as the formulas once more" in text


def test_edge_cases_are_never_empty_and_never_wrong():
    (section,) = ik_edge_cases.run(QUICK, lambda *what: None)
    assert all(target.met for target in section.targets)
    assert [row[1] for row in section.rows] == ["0 (0.0)"] * 9
    assert section.columns[2:7] == tuple(WITH_APPROXIMATE)


def test_judge_counts_empty_wrong_and_raising():
    T = random_poses(np.random.default_rng(0), 4)
    right = [FLANGE.all_solutions(pose).q[:1] for pose in T]
    answers = iter([right[0], np.vstack([right[1], right[1] + 0.1]), np.empty((0, 6)), None])

    def solve(pose):
        answer = next(answers)
        if answer is None:
            raise RuntimeError("no solution")
        return answer

    tally = ik_edge_cases.judge(solve, T)
    assert tally.empty == 50.0
    assert tally.spurious == pytest.approx(100 / 3)
    assert tally.worst < 1e-10


def test_solved_counts_limits_and_accuracy():
    T = random_poses(np.random.default_rng(0), 3)
    q = [FLANGE.all_solutions(pose).q[:1] for pose in T]
    turned = [x + 2 * np.pi * (np.arange(6) == 5) * np.where(x > 0, 1, -1) for x in q]
    for answers, share in ((iter(q), 100.0), (iter([q[0], turned[1], q[2] + 0.01]), 100 / 3)):
        assert ik_single._solved(lambda pose, answers=answers: next(answers), T) == pytest.approx(share)


def test_missing_peers_are_named():
    def absent():
        importlib.import_module("no_such_solver")

    def refuses():
        raise InstallationError("needs another Pinocchio")

    def broken():
        raise TypeError("numpy has changed")

    made, missing = installed({"a": absent, "b": refuses, "c": broken, "d": lambda: 7})
    assert made == {"d": 7}
    assert missing == {
        "a": "not installed (no module no_such_solver); pip install 'kinreach[bench]'",
        "b": "needs another Pinocchio",
        "c": "does not start: TypeError: numpy has changed",
    }


def test_a_suite_without_eaik_names_it_and_has_no_ratio(monkeypatch):
    original = builtins.__import__

    def without(name, *rest):
        if name.startswith("eaik"):
            raise ModuleNotFoundError(name, name="eaik")
        return original(name, *rest)

    for name in [name for name in sys.modules if name.startswith("eaik")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(builtins, "__import__", without)
    (section,) = load_suite("ik-batch")(QUICK, lambda *what: None)
    assert section.missing == {"EAIK": "not installed (no module eaik); pip install 'kinreach[bench]'"}
    assert "kinreach, batch" in [row[0] for row in section.rows]
    assert all(row[3:7] == [None] * 4 for row in section.rows)
    assert section.targets == []


@pytest.mark.parametrize(
    ("suite", "peer", "ours"),
    [("ik-batch", ik_batch.EAIK, ik_batch.OURS), ("fk-batch", fk_batch.PINOCCHIO, fk_batch.OURS)],
)
@pytest.mark.filterwarnings("ignore")
def test_a_peer_is_judged_by_its_quickest_way(suite, peer, ours):
    (section,) = load_suite(suite)(QUICK, lambda *what: None)
    row = next(row for row in section.rows if row[0] == ours)
    assert all(section.columns[column].startswith("x ") for column in (3, 5))
    ratios = {way: 1 / row[column] for way, column in zip(peer, (3, 5), strict=True)}
    (target,) = section.targets
    quickest = min(ratios, key=ratios.get)
    assert target.unit == f"x {quickest}"
    assert target.measured == pytest.approx(ratios[quickest])  # of one round: no median is between


def test_joint_axes():
    kin = ArmKinematics("ur5-thesis")
    assert [base.coordinate_axis(kin, joint) for joint in range(6)] == [2, 1, 1, 1, 2, 1]


def test_forward_kinematics_of_the_loops_agree():
    kin = ArmKinematics("ur5-thesis", tip="tool0", base="world")
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 6))
    np.testing.assert_allclose(fk_batch._all_frames(kin, q), kin.fk(q), atol=1e-10)
    np.testing.assert_allclose(fk_batch._one_frame(kin, q), kin.fk(q), atol=1e-10)


def test_peer_solve_is_prepare_call_postures():
    peer = IKPeer("", lambda T: T + 1, lambda given: given * 2, lambda answer: answer[None])
    np.testing.assert_array_equal(peer.solve(np.ones(6)), np.full((1, 6), 4.0))

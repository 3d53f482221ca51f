"""Arms of random geometry of every class, with turned bases and tips, against Pinocchio."""

import re

import numpy as np
import pytest

from benchmarks.ik_arms import fuzz
from benchmarks.ik_arms.arms import singular_poses, urdf
from benchmarks.ik_arms.random_arms import (
    CLASSES,
    OTHERS,
    Judge,
    apart,
    kinematics,
    moves_to,
    random_motion,
    regular_arm,
    some_arm,
)
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, RedundantKinematics, SevenAxisKinematics, SixAxisKinematics
from kinreach.kinematics._general_6r import Chain
from kinreach.kinematics._seven_axis.tracing import Curve
from kinreach.kinematics._solutions import IKSolutions
from tests.cases import slow
from tests.kinematics.test_six_axis_closed_form import eliminated

ERRORS = (0.0, 1e-6, 1e-5, 1e-4, 1e-3)
#: Classes that `make test` solves singular poses of.
FEW = ("spherical wrist", "three parallel axes")


def judged(kin, judge, T, exact=1e-9):
    """Check all answers for a pose, alone and in a batch; return them."""
    found = kin.all_solutions(T, limits=False)
    for one in found.q:
        assert np.abs(judge.fk(one) - T).max() < exact
    batch = kin.batch(T[None], limits=False)
    assert np.flatnonzero(batch.valid[0]).tolist() == found.branch.tolist()
    same = [apart(one, two[None]) for one, two in zip(batch.q[0][batch.valid[0]], found.q, strict=True)]
    assert max(same, default=0.0) < 1e-6
    return found.q


@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
@pytest.mark.parametrize("name", [*CLASSES, *OTHERS])
def test_six_axes(name, seed, tmp_path):
    rng, count, again = np.random.default_rng([seed, len(name)]), 0, 0
    for off in ERRORS[:: 1 if seed else 4]:
        for backwards in (False, True):
            chain = some_arm(rng, name, backwards=backwards, off=off)
            kin, judge = kinematics(tmp_path, chain), Judge(chain)
            assert isinstance(kin, SixAxisKinematics), (off, backwards)
            for q in rng.uniform(-np.pi, np.pi, (3 if seed else 1, 6)):
                found = judged(kin, judge, judge.fk(q))
                assert apart(q, found) < 1e-5, (off, backwards, q.tolist())
                count, again = count + len(found), again + 1
    assert again == (30 if seed else 4)
    assert count >= 2 * again


@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
@pytest.mark.parametrize("name", [*FEW, *slow(*(name for name in CLASSES if name not in FEW))])
def test_singular_poses(name, seed, tmp_path):
    """Arms of a class and near it, of any angles and of right ones: never empty, alone as in a batch."""
    rng, solved = np.random.default_rng([seed, len(name), 1]), 0
    for some in (some_arm, regular_arm) if seed else (regular_arm,):
        for off in (0.0, 10 ** rng.uniform(-8.0, -3.0))[not seed :]:
            chain = some(rng, name, backwards=bool(rng.integers(2)), off=off)
            kin, judge = kinematics(tmp_path, chain), Judge(chain)
            assert isinstance(kin, SixAxisKinematics)
            for case, poses in singular_poses(ArmKinematics(kin.arm), 2 if seed else 1).items():
                for T in poses:
                    assert len(judged(kin, judge, T, 2e-7)), (some, off, case)
                    solved += 1
    assert solved >= (20 if seed else 3)


@pytest.mark.parametrize(
    ("name", "seed", "off", "backwards", "case", "row"),
    [
        ("spherical wrist, axes 1 and 2 meet", (8881, 68), 1e-5, True, "wrist", 3),
        ("three parallel axes", (8883, 38), 1e-3, True, "right angles", 0),
        *slow(
            ("spherical wrist", (8881, 297), 1e-3, False, "wrist", 3),
            ("spherical wrist, axes 1 and 2 meet", (8881, 145), 1e-8, False, "wrist", 1),
            ("spherical wrist, axes 1 and 2 meet", (8881, 145), 1e-8, False, "beside by 1e-9", 2),
            ("spherical wrist, axes 1 and 2 meet", (8881, 222), 1e-8, False, "wrist", 2),
            ("spherical wrist, axes 1 and 2 parallel", (8881, 36), 1e-5, False, "wrist", 3),
        ),
    ],
)
def test_two_singularities_at_once(name, seed, off, backwards, case, row, tmp_path):
    """The first makes what the arm is off its class larger; at the second that decides which postures there are."""
    rng = np.random.default_rng(seed)
    rng.choice(7), rng.integers(2)
    chain = some_arm(rng, name, backwards=backwards, off=off)
    kin, judge = kinematics(tmp_path, chain), Judge(chain)
    T = singular_poses(ArmKinematics(kin.arm), 4)[case][row]
    found = judged(kin, judge, T)
    others = eliminated(chain, T[None])
    assert others is None or all(apart(one, found) < 1e-4 for one in others[0])
    assert len(found) >= 2


@pytest.mark.parametrize(
    ("index", "case"),
    [
        (73, "wrist elbow shoulder, 1e-07 beside"),
        (842, "wrist elbow, 1e-12 beside"),
        *slow((7, "wrist shoulder, 0 beside"), (7, "upright, 1e-07 beside"), (807, "shoulder, 1e-12 beside")),
    ],
)
def test_poses_that_were_lost(index, case, tmp_path):
    """The arm reaches them at few places of a curve that almost reaches, or folds two equal links there."""
    arm, rng = fuzz.six_axes(40, index, tmp_path)
    poses = [q for name, q in fuzz.postures(arm, rng, 2) if name == case]
    for q in poses:
        T, chain = arm.judge.fk(q), Chain(arm.kin._placements)
        found = judged(arm.kin, arm.judge, T)
        assert apart(q, found) < 1e-5 or moves_to(chain, q, found, T) or any(
            moves_to(chain, one, q[None], T) for one in found
        )  # fmt: skip
    assert poses


def test_curves_that_almost_reach_lead_to_further_postures(tmp_path):
    """Singular poses of an arm a little off its class: without the curves, 67 postures of 86 are listed."""
    (arm, rng), poses, postures = fuzz.six_axes(40, 40, tmp_path), 0, 0
    for _, q in fuzz.postures(arm, rng, 1):
        T = arm.judge.fk(q)
        found = arm.kin.all_solutions(T, limits=False).q
        assert all(np.abs(arm.judge.fk(one) - T).max() < 1e-9 for one in found)
        assert all(apart(one, found[:place]) > 1e-6 for place, one in enumerate(found))
        poses, postures = poses + 1, postures + len(found)
    assert poses == 10
    assert postures >= 80


@pytest.mark.slow
def test_arms_of_the_fuzz(monkeypatch, capsys):
    """No fault on one arm of each class; faults where the last posture of every pose is left out."""
    assert run_fuzz(monkeypatch, "--arms", "11", "--seed", "3") == 0
    assert capsys.readouterr().out.count("│") > 11 * 6
    every = SixAxisKinematics.all_solutions

    def all_but_one(*args, **options):
        found = every(*args, **options)
        return IKSolutions(found.rows[:-1], found.status, found.reason, found._errors)

    monkeypatch.setattr(SixAxisKinematics, "all_solutions", all_but_one)
    assert run_fuzz(monkeypatch, "--arms", "4", "--seed", "3") == 1
    assert re.search("the posture is lost|: empty", capsys.readouterr().out)


def run_fuzz(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["fuzz", *arguments])
    return fuzz.main()


def test_out_of_reach_is_named(tmp_path):
    """No random posture leaves the range; a pose a little outside is named with its distance and the arm's reach."""
    rng, far, close = np.random.default_rng(3), 0, 0
    for name in [*CLASSES, *OTHERS]:
        if name == "spherical wrist, axes 1 and 2 parallel":
            continue  # every point of axis 1 is next to axis 2
        chain = some_arm(rng, name, backwards=False, off=0.0)
        kin, judge = kinematics(tmp_path, chain), Judge(chain)
        lines = [judge.shoulder_and_wrist(q) for q in rng.uniform(-np.pi, np.pi, (300, 6))]
        distances = np.array([np.linalg.norm(wrist - shoulder) for shoulder, wrist in lines])
        for sign, word in ((1.0, "too far away"), (-1.0, "too close")):
            q = rng.uniform(-np.pi, np.pi, 6)
            T, (shoulder, wrist) = judge.fk(q), judge.shoulder_and_wrist(q)
            way = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
            bound = distances.max() if sign > 0 else distances.min()
            wanted = bound + sign * 0.3 * (bound if sign < 0 else 1.0)
            T[:3, 3] += (wanted - np.linalg.norm(wrist - shoulder)) * way
            lost = kin.all_solutions(T, limits=False)
            if sign < 0 and lost:
                continue  # it can fold further than any of these postures
            if sign < 0 and not lost.reason.startswith(word):
                assert lost.reason == "no posture reaches the goal"
                continue
            assert lost.reason.startswith(word), (name, lost.reason)
            would, reach = map(float, re.findall(r"\d+\.\d{3}", lost.reason))
            assert would == pytest.approx(wanted, abs=1e-3)
            assert sign * (reach - bound) > -1e-3
            assert abs(reach - bound) < 0.1 * distances.max()
            far, close = far + (sign > 0), close + (sign < 0)
    assert far == 10
    assert close >= 3


@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
def test_seven_axes(seed, tmp_path):
    """Any seven axes: every curve is closed, every sample reaches, and the posture of the pose is on one."""
    rng, curves = np.random.default_rng([seed, 7]), 0
    for _ in range(2):
        chain = np.array([random_motion(rng, 0.4, np.pi) for _ in range(8)])
        kin, judge = kinematics(tmp_path, chain), Judge(chain)
        assert isinstance(kin, SevenAxisKinematics)
        for q in rng.uniform(-np.pi, np.pi, (3, 7)):
            T = judge.fk(q)
            motions = kin.self_motions(T, limits=False)
            known = [Curve(curve.q, curve.closed, curve.tangent) for curve in motions]
            assert all(curve.closed for curve in motions)
            assert len(kin._tracer.beside(known, q[None], T)) == 0
            for curve in motions:
                assert max(np.abs(judge.fk(one) - T).max() for one in curve.q[::20]) < 1e-9
            curves += len(motions)
    assert curves >= 6


def test_other_joints_have_no_closed_form(tmp_path):
    """Eight joints, two, and one that slides are refused by the classes that list all postures."""
    rng = np.random.default_rng(0)
    for joints in (2, 8):
        kin = kinematics(tmp_path, np.array([random_motion(rng, 0.3, np.pi) for _ in range(joints + 1)]))
        assert type(kin) is (ArmKinematics if joints == 2 else RedundantKinematics)
        with pytest.raises(InputError, match=f"{joints} joints; six are needed"):
            SixAxisKinematics(kin.arm)
        with pytest.raises(InputError, match=f"{joints} joints; seven are needed"):
            SevenAxisKinematics(kin.arm)
        for name in ("all_solutions", "self_motions", *["nearest"] * (joints == 2)):
            with pytest.raises(AttributeError, match=f"with {joints} joints has no {name}: Levenb.* or PlacoSolver"):
                getattr(kin, name)
    file = tmp_path / "sliding.urdf"
    chain = np.array([random_motion(rng, 0.3, np.pi) for _ in range(7)])
    file.write_text(urdf(chain).replace('type="revolute"', 'type="prismatic"', 1))
    held = ArmKinematics.from_urdf(file)  # a base that slides is held, and that is said
    assert held.n == 5
    assert any("j1" in note for note in held.arm.notes)
    taken = ArmKinematics.from_urdf(file, joints=("j1", "j2", "j3", "j4", "j5", "j6"))
    assert taken.slides.tolist() == [True] + 5 * [False]
    with pytest.raises(InputError, match="a joint that slides; SixAxisKinematics takes joints that turn"):
        SixAxisKinematics(taken.arm)
    six, seven = (kinematics(tmp_path, np.array([random_motion(rng, 0.3, np.pi) for _ in range(n)])) for n in (7, 8))
    with pytest.raises(AttributeError, match="6 joints has no self_motions: all_solutions lists its postures"):
        six.self_motions(np.eye(4))
    with pytest.raises(AttributeError, match="7 joints has no all_solutions: self_motions has its curves"):
        seven.all_solutions(np.eye(4))
    assert not hasattr(six, "clearest")
    with pytest.raises(AttributeError, match="'SixAxisKinematics' object has no attribute 'other'"):
        six.other  # noqa: B018

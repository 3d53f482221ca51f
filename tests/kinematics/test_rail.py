"""Six axes on a slide: the curves against the six-axis arm at many places of the slide, limits, and what is chosen."""

import re

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.ik_arms.arms import urdf
from benchmarks.ik_arms.random_arms import CLASSES, OTHERS, some_arm
from kinreach.errors import InputError
from kinreach.kinematics import (
    ArmKinematics,
    CollisionChecker,
    RedundantKinematics,
    SevenAxisKinematics,
    Status,
)
from kinreach.robots import ArmDescription, get_arm
from tests.cases import slow
from tests.kinematics.test_coupled_and_sliding import chain, joint
from tests.robots.peoples_files import arm, shape

SIX = tuple(f"j{i}" for i in range(1, 7))
#: Places of the slide at which a pose's curves are compared.
PLACES = 25
#: Two postures are one [rad, m].
SAME = 1e-5


def on_slide(text, axis, *, root="l0", last="", limits=(-3.0, 3.0)):
    """A URDF of an arm on a slide, or with one behind its link `last`."""
    parent, child = (last, "end") if last else ("floor", root)
    slide = (
        f'<link name="{"end" if last else "floor"}"/><joint name="rail" type="prismatic"><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{" ".join(map(str, axis))}"/>'
        f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="9" velocity="1"/></joint>'
    )
    return text.replace("</robot>", f"{slide}</robot>")


def written(folder, text, **options):
    file = folder / "slide.urdf"
    file.write_text(text)
    return ArmKinematics.from_urdf(file, **options)


def some_railed(rng, folder, name, *, last, limits=(-3.0, 3.0)):
    """A random arm of a class on a slide along a random axis, the six axes alone, and the axis."""
    text, axis = urdf(some_arm(rng, name)), rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    six = written(folder, text)
    railed = on_slide(text, axis, last="l7" if last else "", limits=limits)
    kin = written(folder, railed, joints=[*SIX, "rail"] if last else ["rail", *SIX], tip="end" if last else "l7")
    assert type(kin) is SevenAxisKinematics
    return kin, six, axis


def ur_on_rail(folder, limits=(-0.5, 0.5)):
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", get_arm("ur5e").urdf, flags=re.DOTALL)
    railed = on_slide(text, (0, 1, 0), root="world", limits=limits)
    return written(folder, railed, joints=["rail", *get_arm("ur5e").joints], tip="tool0")


def of_six(six, axis, T, places, *, last):
    """The six-axis arm's postures for a pose with the slide at places, one list (k, 6) a place."""
    back = np.tile(np.eye(4), (len(places), 1, 1))
    back[:, :3, 3] = -places[:, None] * axis
    found = six.batch(T @ back if last else back @ T, limits=False)
    return [q[valid] for q, valid in zip(found.q, found.valid, strict=True)]


def apart(q, others):
    """Largest difference of a joint of each posture (m, n) from the nearest of others, turns aside [rad]."""
    away = (q[:, None] - others + np.pi) % (2 * np.pi) - np.pi
    return np.abs(away).max(axis=2).min(axis=1, initial=np.inf)


def compared(kin, six, axis, q):
    """The curves of a posture's pose have what the six axes have at places of the slide; returns how many that is."""
    slide = int(np.flatnonzero(kin.slides)[0])
    T = kin.fk(q)
    motions = kin.self_motions(T, limits=False)
    places = np.append(np.random.default_rng(0).uniform(q[slide] - kin.length, q[slide] + kin.length, PLACES), q[slide])
    count = 0
    for place, theirs in zip(places, of_six(six, axis, T, places, last=slide == 6), strict=True):
        ours = motions.with_joint("rail", place)
        assert all(each.q[slide] == pytest.approx(place, abs=1e-9) for each in ours)
        assert all(max(each.position_error, each.orientation_error) < 1e-9 for each in ours)
        mine = np.array([np.delete(each.q, slide) for each in ours]).reshape(-1, 6)
        assert len(mine) == len(theirs)
        assert (apart(theirs, mine) < SAME).all()
        count += len(mine)
    assert apart(q[None, ~kin.slides], np.vstack([each.q for each in motions])[:, ~kin.slides])[0] < 0.15
    return count


@pytest.mark.parametrize(("seed", "poses"), [(0, 1), *slow((1, 5))])
def test_curves_have_every_posture_of_the_six_axes_wherever_the_slide_is(seed, poses, tmp_path):
    rng, count, compares = np.random.default_rng(seed), 0, 0
    names = [*CLASSES, *OTHERS]
    for name in names if poses > 1 else names[::3]:
        for last in (False, True) if poses > 1 else (bool(len(name) % 2),):
            kin, six, axis = some_railed(rng, tmp_path, name, last=last)
            for _ in range(poses):
                q = rng.uniform(-np.pi, np.pi, 7)
                q[kin.slides] = rng.uniform(-2.0, 2.0)
                count, compares = count + compared(kin, six, axis, q), compares + 1
    assert compares >= (100 if poses > 1 else 4)
    assert count > 20 * compares


def test_curves_are_continuous_and_reach_the_pose_by_pinocchio(tmp_path):
    rng, count = np.random.default_rng(2), 0
    for last in (False, True):
        kin, *_ = some_railed(rng, tmp_path, "three parallel axes, right angles", last=last)
        model = pin.buildModelFromXML((tmp_path / "slide.urdf").read_text())
        data, tip = model.createData(), model.getFrameId(kin.arm.tips[kin.tip])
        unit = np.where(kin.slides, kin.length, 1.0)
        np.testing.assert_array_equal(kin.unit, unit)
        q = rng.uniform(-2.0, 2.0, 7)
        T = kin.fk(q)
        for curve in kin.self_motions(T, limits=False):
            steps = np.linalg.norm(np.diff(curve.q, axis=0) / unit, axis=1)
            assert steps.max() < 0.15
            np.testing.assert_allclose(np.cumsum(steps), curve.length[1:], atol=1e-9)
            assert curve.closed
            still = np.einsum("mij,mj->mi", kin.jacobian(curve.q), curve.tangent)
            assert np.abs(still).max() < 1e-9
            np.testing.assert_allclose(np.linalg.norm(curve.tangent / unit, axis=1), 1.0)
            middle = curve.at(0.4 * curve.total)
            for posture in (*curve.q[::9], middle):
                pin.framesForwardKinematics(model, data, posture)
                assert np.abs(data.oMf[tip].homogeneous - T).max() < 1e-9
                count += 1
    assert count > 30


def test_curves_end_at_limits_exactly_or_do_not_end(tmp_path):
    """And within them nothing is lost: the slide's limits and the joints' cut what the six axes have."""
    kin, six = ur_on_rail(tmp_path), ArmKinematics.of(get_arm("ur5e"), tip="tool0", base="world")
    kin = ArmKinematics.of(kin.arm.with_limits(dict.fromkeys(kin.arm.joints[1:], (-2.5, 2.5))), base="world")
    rng, ends, at_rail, count = np.random.default_rng(3), 0, 0, 0
    for _ in range(6):
        T = kin.fk(rng.uniform(kin.lower, kin.upper))
        motions = kin.self_motions(T)
        for curve in motions:
            assert not kin.past_limits(curve.q, 0.0 if curve.closed else 1e-9).any()
            for end in () if curve.closed else (curve.q[0], curve.q[-1]):
                assert np.abs(np.concatenate([end - kin.lower, kin.upper - end])).min() < 1e-12
                at_rail += end[0] in (kin.lower[0], kin.upper[0])
                ends += 1
        places = rng.uniform(kin.lower[0], kin.upper[0], PLACES)
        for place, theirs in zip(places, of_six(six, np.array([0, 1, 0]), T, places, last=False), strict=True):
            theirs = theirs[~(np.abs(theirs) > 2.5 + 1e-9).any(axis=1)]
            mine = np.array([each.q[1:] for each in motions.with_joint("rail", place)]).reshape(-1, 6)
            assert len(mine) == len(theirs)
            assert (apart(theirs, mine) < SAME).all()
            count += len(mine)
    assert ends > 30
    assert at_rail > 5
    assert count > 150


def test_the_nearest_is_nearer_than_all_places_of_the_slide_have(tmp_path):
    rng, count = np.random.default_rng(4), 0
    kin, six = ur_on_rail(tmp_path), ArmKinematics.of(get_arm("ur5e"), tip="tool0", base="world")
    kin = ArmKinematics.of(kin.arm, base="world")
    unit = np.append(kin.length, np.ones(6))
    assert kin.length == pytest.approx(np.linalg.norm(kin.chain.placements[1:, :3, 3], axis=1).sum())
    places = np.linspace(kin.lower[0], kin.upper[0], 200)
    for _ in range(8):
        q, seed = rng.uniform(kin.lower, kin.upper, (2, 7)) / [1, 2, 2, 2, 2, 2, 2]
        T = kin.fk(q)
        found, itself = kin.nearest(T, seed), kin.nearest(T, q)
        np.testing.assert_allclose(itself.q, q, atol=1e-8)
        assert found.success
        assert max(found.position_error, found.orientation_error) < 1e-9
        assert kin.within_limits(found.q, tolerance=0.0)
        for place, theirs in zip(places, of_six(six, np.array([0, 1, 0]), T, places, last=False), strict=True):
            others = np.column_stack([np.full(len(theirs), place), theirs])
            others[:, 1:] += 2 * np.pi * np.rint((seed - others)[:, 1:] / (2 * np.pi))
            others = others[~kin.past_limits(others).any(axis=1)]
            least = np.linalg.norm((others - seed) / unit, axis=1).min(initial=np.inf)
            assert np.linalg.norm((found.q - seed) / unit) < least + 1e-6
            count += len(others)
        left = kin.nearest(T, seed, accept=lambda posture: posture[0] < 0.0)
        assert left.status in (Status.OK, Status.REJECTED)
        assert not left.success or left.q[0] < 0.0
    assert count > 1000


def test_the_most_manipulable_and_the_clearest_over_all_places(tmp_path):
    solids = dict.fromkeys(range(7), shape('<cylinder radius="0.02" length="0.05"/>', "collision"))
    kin = written(tmp_path, on_slide(arm(links=solids), (1, 0, 0), limits=(-0.4, 0.4)), joints=["rail", *SIX])
    unit, rng, checker = np.append(kin.length, np.ones(6)), np.random.default_rng(5), CollisionChecker(kin)

    def much(q):
        J = kin.jacobian(q) * unit
        return np.sqrt(max(np.linalg.det(J @ J.T), 0.0))

    for _ in range(3):
        T = kin.fk(rng.uniform(0.8 * kin.lower, 0.8 * kin.upper))
        motions = kin.self_motions(T)
        sampled = np.vstack([curve.q for curve in motions])
        best, clear = kin.manipulable(T), kin.clearest(T, checker)
        assert best.success
        assert much(best.q) >= max(map(much, sampled)) * (1 - 1e-6)
        assert np.abs(kin.fk(clear.q) - T).max() < 1e-8
        most = max(checker.distance(q).distance for q in sampled[::4])
        assert checker.distance(clear.q).distance > most - 0.01


def test_slides_elsewhere_are_numeric_and_it_is_said(tmp_path):
    between = chain(
        *[(name, "revolute", {"xyz": "0.1 0.2 0.1", "rpy": "1.2 0.4 0"}) for name in SIX[:3]],
        ("rail", "prismatic", {"limits": (0.0, 0.3)}),
        *[(name, "revolute", {"xyz": "0.1 0.1 0.2", "rpy": "0.9 0.2 0"}) for name in SIX[3:]],
    )
    kin = written(tmp_path, between, joints=[*SIX[:3], "rail", *SIX[3:]])
    assert type(kin) is RedundantKinematics
    assert "has a joint that slides (rail)" in kin.no_closed_form
    assert "one slide, the first or the last" in kin.no_closed_form
    with pytest.raises(InputError, match="has 6 joints; seven are needed"):
        SevenAxisKinematics("ur5e")


def test_a_rail_under_a_file_with_a_joint_of_any_name(tmp_path):
    text = arm(more=f'<link name="floor"/>{joint("world_joint", "prismatic", "floor", limits=(0, 1))}')
    text = re.sub(r'<link name="world_joint_link">.*?</link>', "", text).replace("world_joint_link", "l0")
    (tmp_path / "named.urdf").write_text(text)
    described = ArmDescription.from_file(tmp_path / "named.urdf", joints=["world_joint", *SIX])
    assert type(ArmKinematics.of(described)) is SevenAxisKinematics

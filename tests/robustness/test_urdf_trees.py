"""Descriptions of arms whose links are no tree, or whose limits are in the wrong order."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import arm_names, get_arm
from kinreach.robots._urdf import check_urdf

ARM3 = get_arm("arm3")


def robot_of(joints, links="ABCD"):
    """A URDF of links, with a revolute joint for each pair of parent and child."""
    parts = [f'<link name="{link}"/>' for link in links]
    for index, (parent, child) in enumerate(joints):
        parts.append(
            f'<joint name="j{index}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    return f"<robot name='a'>{''.join(parts)}</robot>"


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (["AB", "CD", "DC"], "'C', 'D'"),
        (["BC", "CD", "DB"], "'B', 'C', 'D'"),
        (["AB", "BC", "DD"], "'D'"),
        (["AA", "AB", "BC"], "'A', 'B', 'C'"),
        (["AB", "AC", "BC"], "each of which hangs on one joint at most"),
        (["AB", "CD"], "got 2 that hang on none"),
        (["AB", "BC", "CD", "DA"], "got 0 that hang on none"),
    ],
)
def test_links_that_are_no_tree_are_refused(joints, said):
    check_urdf(robot_of(["AB", "BC", "BD"]), None)
    with pytest.raises(InputError, match=said):
        check_urdf(robot_of(joints), None)


def test_trees_are_told_from_other_graphs():
    """A graph of n links and n - 1 joints is a tree if it is connected: as SciPy says."""
    rng = np.random.default_rng(0)
    trees = 0
    for _ in range(600):
        names = [f"l{i}" for i in rng.permutation(int(rng.integers(1, 8)))]
        n = len(names)
        children = rng.choice(n, n - 1, replace=False)
        shape = rng.random()
        parents = [int(rng.integers(n) if shape < 0.5 else rng.integers(max(child, 1))) for child in children]
        joints = list(zip(parents, children.tolist(), strict=True))
        matrix = coo_array((np.ones(n - 1), ([p for p, _ in joints], [c for _, c in joints])), shape=(n, n))
        is_tree = connected_components(matrix, directed=False)[0] == 1
        trees += is_tree
        text = robot_of([(names[p], names[c]) for p, c in joints], names)
        if is_tree:
            check_urdf(text, None)
        else:
            with pytest.raises(InputError, match="must hang on"):
                check_urdf(text, None)
    assert 200 < trees < 400


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize(
    ("limits", "good"),
    [
        ('lower="-1" upper="1"', True), ('lower="0.5" upper="0.5"', True), ('upper="1"', True), ("", True),
        ('lower="1" upper="-1"', False), ('lower="1e-9"', False), ('upper="-0.1"', False),
        ('lower="nan" upper="1"', False), ('lower="-inf" upper="inf"', False), ('lower="x" upper="1"', False),
        ('lower="" upper="1"', False), ('lower="1 2" upper="3"', False),
    ],
)  # fmt: skip
def test_limits_are_in_order(kind, limits, good):
    text = robot_of(["AB"], "AB").replace('lower="-1" upper="1"', limits).replace("revolute", kind)
    if good:
        check_urdf(text, None)
        return
    with pytest.raises(InputError, match=r"lower|upper"):
        check_urdf(text, None)


def test_limits_that_mean_nothing_are_not_looked_at():
    """A joint that turns without end has none, and the standard says to leave them out."""
    text = robot_of(["AB"], "AB").replace('lower="-1" upper="1"', 'lower="1" upper="-1"')
    check_urdf(text.replace("revolute", "continuous"), None)


def test_a_solver_is_given_no_arm_with_limits_in_the_wrong_order():
    robot = ET.fromstring(ARM3.urdf)
    limit = next(robot.iter("limit"))
    lower, upper = limit.get("lower"), limit.get("upper")
    limit.set("lower", upper)
    limit.set("upper", lower)
    text = ET.tostring(robot, encoding="unicode")
    with pytest.raises(InputError, match="lower limit"):
        ArmKinematics(replace(ARM3, build_urdf=lambda: text))


def test_the_arms_of_the_package_are_trees():
    assert {"arm3", "ur5"} <= set(arm_names())
    for name in arm_names():
        assert ArmKinematics(name).model.nq == len(get_arm(name).joints)

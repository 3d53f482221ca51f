"""What an exported program says of its waypoints: joint angles, poses, and the tool set before each one's use."""

import re

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.kinematics import pose
from kinreach.robots._pairs import looks_like_rows, pairs_of
from kinreach.robots._polyscope import read_export

TOOLS = [[0.0, 0.0, 0.1, 0.0, 0.0, 0.0], [0.0, 0.03, 0.25, 0.0, 0.4, 0.0], [0.01, 0.0, 0.2, 0.1, 0.0, 0.3]]


def waypoint(name, seed):
    """Its two lines, and its numbers."""
    q, p = np.round(np.random.default_rng(seed).uniform(-1, 1, (2, 6)), 4).tolist()
    return [f"  global {name}_p=p{p}", f"  global {name}_q={q}"], q, p


def move(name):
    return f"  movej(get_inverse_kin({name}_p, qnear={name}_q))"


def written(*parts):
    lines = ["def made_up():"]
    for part in parts:
        lines += part if isinstance(part, list) else [part]
    return "\n".join([*lines, "end"])


def floats(tcps):
    return [None if tcp is None else [float(word) for word in tcp.split(",")] for tcp in tcps]


@pytest.mark.parametrize("seed", range(4))
def test_each_waypoint_has_the_tool_that_is_set_last_before_its_use(seed):
    """In whatever order they are written down; by numbers or a variable, and not in a comment or after it."""
    order = np.random.default_rng(seed).permutation(6)
    names = [f"W{index}" for index in range(6)]
    head = [line for index in order for line in waypoint(names[index], int(index))[0]]
    text = written(
        head, f"  set_tcp(p{TOOLS[0]})", move("W0"), move("W1"), f"  my_tool = p{TOOLS[1]}", "  set_tcp(my_tool)",
        move("W2"), f"  # set_tcp(p{TOOLS[0]})", move("W3"), f"  set_tcp(p{TOOLS[2]})", move("W4"), move("W0"),
    )  # fmt: skip
    export = read_export(text)
    assert export.names == tuple(names[index] for index in order)
    tools = dict(zip(names, [*TOOLS[:1] * 2, *TOOLS[1:2] * 2, TOOLS[2], None], strict=True))
    assert floats(export.tcps) == [tools[name] for name in export.names]
    for name, q, p in zip(export.names, export.q, export.poses, strict=True):
        _, own_q, own_p = waypoint(name, int(name[1:]))
        assert ([float(word) for word in q], [float(word) for word in p]) == (own_q, own_p)


def test_before_any_tool_and_with_an_unknown_one_the_tool_is_not_known():
    """If there is just one, it is that of all; one that a function returns is not known."""
    points = [waypoint(name, seed)[0] for seed, name in enumerate(("A", "B", "C"))]
    first, second = (f"  set_tcp(p{tool})" for tool in TOOLS[:2])
    two = read_export(written(*points, move("A"), first, move("B"), second, move("C")))
    assert floats(two.tcps) == [None, *TOOLS[:2]]
    for other in ("  set_tcp(measured())", "  set_tcp(p[0, 0, 1])", "  set_tcp(p[0, 0, x, 0, 0, 0])"):
        one = read_export(written(*points, first, move("A"), other, move("B"), second, move("C")))
        assert floats(one.tcps) == [TOOLS[0], None, TOOLS[1]]
    assert floats(read_export(written(*points, move("A"), first, move("B"))).tcps) == TOOLS[:1] * 3
    assert read_export(written(*points)).tcps == [None] * 3


def test_waypoints_without_a_known_tool_are_left_out_and_named():
    points = [waypoint(name, seed)[0] for seed, name in enumerate(("A", "B", "C", "D"))]
    first, second = (f"  set_tcp(p{tool})" for tool in TOOLS[:2])
    text = written(*points, move("A"), first, move("B"), move("D"), second, move("C"))
    pairs = pairs_of(text.encode(), "two.script")
    assert pairs.places == ("B", "C", "D")
    np.testing.assert_allclose(pairs.q, [waypoint(name, seed)[1] for seed, name in ((1, "B"), (2, "C"), (3, "D"))])
    np.testing.assert_allclose(
        pairs.seen, pose([waypoint(name, seed)[2] for seed, name in ((1, "B"), (2, "C"), (3, "D"))])
    )
    np.testing.assert_allclose(pairs.tcp, pose([TOOLS[0], TOOLS[1], TOOLS[0]]))
    assert pairs.notes == (
        "two.script sets 2 tool centre points: each waypoint has the one that is set before its use",
        "A of two.script are left out: which tool centre point they have is not known",
    )
    assert pairs.only_tcp is None
    plain = pairs_of(written(*points).encode(), "plain.script")
    assert (plain.places, plain.tcp, plain.notes) == (("A", "B", "C", "D"), None, ())


def test_what_has_rows_looks_like_it():
    """An exported program, or a line of six numbers, however they are separated."""
    rows = [b"def made_up():\nend", b"  A_p = p[1, 2]", b"1,2,3,4,5,6", b"a\n-1.5e-3; 2; 3; 4; 5; 6; 7", b"1 2 3 4 5 6",
            b'"1"\t"2"\t"3"\t"4"\t"5"\t"6"']  # fmt: skip
    others = [b"", b"1,2,3,4,5", b"a: 1\nb: 2\nc: 3\nd: 4\ne: 5\nf: 6", b"undefined p[1]", b"x 1,2,3,4,5,6"]
    assert [looks_like_rows(content) for content in rows] == [True] * len(rows)
    assert [looks_like_rows(content) for content in others] == [False] * len(others)


def test_a_program_without_poses_is_refused():
    with pytest.raises(InputError, match=re.escape("a.script has no waypoint with joint angles and a pose (NAME_q=[")):
        pairs_of(b"def made_up():\n  global A_q=[0,0,0,0,0,0]\nend", "a.script")

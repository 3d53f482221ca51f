"""How programs are checked and begun, in their parts."""

import re
from collections import Counter
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinreach.deploy import Move, Program, read_trajectory, write_trajectory
from kinreach.deploy._controller import FINISHED, NOT_AT_START, Controller
from kinreach.deploy._model import MAX_OFF, MAX_OFF_CALIBRATED, ModelCheck
from kinreach.deploy._script_functions import FUNCTIONS, Required
from kinreach.deploy._script_tree import (
    Assignment,
    Call,
    Choice,
    Constant,
    Definition,
    Element,
    Name,
    Negative,
    Numbers,
    Operation,
    Order,
    OwnCall,
    ScriptError,
    While,
    number_text,
)
from kinreach.deploy._urscript import parse
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, pose, pose_vector
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm
from tests.deploy.test_programs import HOME, KIN, REFUSED, finite, moves, sixes, swing

models = st.integers(1, 4).flatmap(lambda count: st.builds(
    ModelCheck, st.tuples(*[sixes] * count), st.tuples(*[sixes] * count), st.sampled_from([MAX_OFF, MAX_OFF_CALIBRATED])
))  # fmt: skip


@settings(max_examples=30)
@given(sixes, sixes, st.lists(moves, max_size=6), sixes, st.none() | st.floats(0, 50), st.tuples(*[finite] * 3),
       st.none() | models, st.integers(0, 2**31 - 1))  # fmt: skip
def test_moves_come_back_as_they_were(start, tcp, some, last, payload, centre, model, run):
    settings = {} if payload is None else {"payload": payload, "centre_of_mass": centre}
    program = Program(start, tcp, (*some, Move("movej", last, 0.5, 1.0)), model=model, **settings)
    assert Program.parse(program.text_of_run(run)) == program


def test_a_program_may_be_shorter_than_other_files(tmp_path, monkeypatch):
    monkeypatch.setattr("kinreach.deploy._trajectory_files.MAX_CHARACTERS", 1000)
    for name in ("a.json", "a.csv"):
        write_trajectory(swing(), tmp_path / name)
        assert (tmp_path / name).stat().st_size > 1000
        assert len(read_trajectory(tmp_path / name).t) > 1
    (tmp_path / "a.script").write_text(Program.of(KIN, HOME, swing()).text)
    with pytest.raises(InputError, match=r"a\.script: it has \d+ bytes, larger than 1000 bytes"):
        read_trajectory(tmp_path / "a.script")


def test_functions_of_a_program_are_those_that_the_parser_knows():
    texts = Program.of(KIN, HOME, swing(), payload=1.0).text + Program.of(
        KIN, HOME, [Move("movel", pose_vector(KIN.fk(HOME)), 0.1, 1.0)]).text + Program.of(
        KIN, HOME, [Move("movej", HOME, 0.1, 1.0)]).text  # fmt: skip
    used = set(re.findall(r"(\w+)\(", re.sub(r"#.*|\"[^\"]*\"|^def.*", "", texts, flags=re.MULTILINE)))
    assert len(used) > 12
    assert used <= set(FUNCTIONS)


@pytest.mark.parametrize("name", ["ur5e_a", "ur5_a"])
@pytest.mark.slow
def test_programs_move_a_calibrated_arm_as_they_say(name):
    model = name[:-2]
    arm = get_arm(model).calibrated(PUBLISHED_CALIBRATIONS[name]).with_tool([0, 0, 0.1, 0, 0, 0])
    kin = ArmKinematics.of(arm, base="base")
    home = np.array(arm.home)
    goal = pose_vector(kin.fk(home) @ pose([0.05, 0.08, -0.1, 0, 0.1, 0]))
    joint = kin.nearest(pose(goal), home).q
    ways = {
        "movej": [Move("movej", joint, 0.8, 1.4)],
        "movel": [Move("movel", goal, 0.25, 1.2)],
        "both": [Move("movel", goal, 0.25, 1.2, 0.01), Move("movej", home + 0.1, 0.8, 1.4)],
        "servoj": swing(start=home),
    }
    ends = {"movej": joint, "movel": joint, "both": home + 0.1, "servoj": swing(start=home).q[-1]}
    for way, motion in ways.items():
        program = Program.of(kin, home, motion)
        ur = Controller(arm)
        done = ur.run(program.text)
        assert (done.status, done.reason) == (FINISHED, ""), way
        np.testing.assert_allclose(done.commanded.q[-1], ends[way], atol=1e-4)
        assert pose_vector(ur.tcp) == pytest.approx(program.tcp)
    rate = {"ur5e": 500, "ur5": 125}[model]  # the controllers' cycles
    assert Program.of(kin, home, ways["servoj"]).trajectory.t[1] == pytest.approx(1 / rate)
    assert Program.of(kin, home, ways["servoj"]).text.count("servoj") == rate + 1


@pytest.mark.parametrize("motion", ["movej", "movel", "servoj"])
@pytest.mark.slow
def test_nothing_moves_where_the_arm_does_not_stand_at_the_start(motion):
    """Where it moves, it goes to the start posture first, and from there as from the start posture itself."""
    goal = HOME + 0.1
    motions = {"movej": [Move("movej", goal, 0.5, 1.0)], "movel": [Move("movel", pose_vector(KIN.fk(goal)), 0.2, 1.0)],
               "servoj": swing()}  # fmt: skip
    program = Program.of(KIN, HOME, motions[motion])
    ur = Controller(KIN.arm, q=HOME, log=(log := []).append)
    tried, rng = ur.run(program.text).commanded.q, np.random.default_rng(5)
    for joint in range(6):
        for off, status in ((1.05, NOT_AT_START), (0.95, FINISHED))[: 1 + joint % 2]:
            start = HOME.copy()
            start[joint] += rng.choice([-1, 1]) * off * program.tolerance
            log.clear()
            ur.place(start)
            done = ur.run(program.text)
            assert done.status == status
            if status == NOT_AT_START:
                assert not done.commanded.qd.any()
                np.testing.assert_allclose(done.measured.q, np.broadcast_to(start, done.measured.q.shape), atol=1e-3)
                assert any("not at the start posture" in line for line in log)
                continue
            exact = np.flatnonzero((done.commanded.q == HOME).all(axis=1))[0]
            assert 0 < exact < 0.2 / ur.cycle
            to_start = done.commanded.q[: exact + 1, joint]
            assert (np.diff(to_start) * np.sign(HOME[joint] - start[joint]) > 0.0).all()
            np.testing.assert_allclose(
                done.commanded.q[exact:][: len(tried)], tried[-len(done.commanded.q[exact:]) :], atol=1e-12
            )


def test_defaults_are_those_of_universal_robots_manual():
    for line, defaults in (
        ("movej([0])", {"a": 1.4, "v": 1.05, "t": 0, "r": 0}),
        ("movel([0])", {"a": 1.2, "v": 0.25, "t": 0, "r": 0}),
        ("servoj([0])", {"a": 0, "v": 0, "t": 0.002, "lookahead_time": 0.1, "gain": 300}),
        ('popup("a")', {"title": "Popup", "warning": False, "error": False, "blocking": False}),
        ('textmsg("a")', {"s2": ""}),
    ):
        _, *given = parse(line).body[0].arguments.items()
        assert {name: constant.value for name, constant in given} == defaults


def test_levels_count_within_one_another_and_not_one_after_another():
    part = "  x = [1, -2]\n  y = -x[1] - norm(-x[0])\n  if y > 1:\n    sleep(1)\n  else:\n    sleep(2)\n  end\n"
    assert len(parse(f"def f():\n{60 * part}end\n").body) == 180


WHOLE = """def main():
  def f(b, c=2):
    return -b + c
  end
  a = 1
  local x = -a
  q = [1, 2.5, a]
  q[1] = p[0, 0, 0, 0, 0, 0]
  if not (a == 2) and True:
    textmsg("no", x)
  else:
    while a < 2:
      a = a + q[0]
      break
    end
  end
  thread t():
    halt
  end
  h = run t()
  f(1, c=2)
  join h
end
"""


def test_a_program_is_what_it_says_wherever_that_stands():
    """Places of its parts are no part of what is compared, and point at their words."""
    a, two = Name("a"), Constant(2.0)
    tree = (
        Definition("def", "f", {"b": Required, "c": two}, (
            Order("return", Operation("+", Negative(Name("b")), Name("c"))),)),
        Assignment("a", Constant(1.0)),
        Assignment("x", Negative(a), scope="local"),
        Assignment("q", Numbers((Constant(1.0), Constant(2.5), a), is_pose=False)),
        Assignment("q", Numbers((Constant(0.0),) * 6, is_pose=True), indices=(Constant(1.0),)),
        Choice(
            Operation("and", Negative(Operation("==", a, two), sign="not"), Constant(value=True)),
            (Call("textmsg", {"s1": Constant("no"), "s2": Name("x")}),),
            (While(Operation("<", a, two), (
                Assignment("a", Operation("+", a, Element(Name("q"), Constant(0.0)))), Order("break"))),),
        ),
        Definition("thread", "t", {}, (Order("halt"),)),
        Assignment("h", OwnCall("t", (), {}, is_run=True)),
        OwnCall("f", (Constant(1.0),), {"c": two}),
        Order("join", Name("h")),
    )  # fmt: skip
    moved = WHOLE.replace("\n", "  # said\n\n\n  ").replace(", ", " ,   ").replace(" = ", "   =  ").replace("-", "- ")
    lines, seen = {WHOLE: WHOLE.splitlines(), moved: moved.splitlines()}, Counter()

    def check(node, text):
        if not is_dataclass(node):
            for part in node.values() if isinstance(node, dict) else node if isinstance(node, tuple) else ():
                check(part, text)
            return
        for part in fields(node):
            check(getattr(node, part.name), text)
        word = getattr(node, "sign", "") or getattr(node, "function", "") or getattr(node, "word", "")
        word = word or getattr(node, "name", "")
        if hasattr(node, "place"):
            rest = lines[text][node.place.line - 1][node.place.column - 1 :]
            assert not word or rest.removeprefix("run ").startswith(word), (rest, node)
            seen[type(node).__name__] += 1

    for text in lines:
        assert parse(text).body == tree
        check(parse(text).body, text)
    assert len(seen) == 12
    assert parse(WHOLE.replace("a < 2", "a < 3")).body != tree


@pytest.mark.parametrize("text", REFUSED)
def test_other_urscript_is_refused_before_anything_moves(text):
    with pytest.raises(ScriptError, match=REFUSED[text]) as refused:
        parse(text)
    assert str(refused.value).startswith(f"line {refused.value.line}")
    ur = Controller(KIN.arm)
    with pytest.raises(InputError):
        ur.start(text)
    ur.tick()
    assert not ur.target_qd.any()


@pytest.mark.slow
@given(st.text(max_size=80) | st.lists(st.sampled_from(
    ["def", " ", "f", "(", ")", ":", "\n", "end", "if", "else", "[", "]", "p", ",", "=", "-", ">", "or", "1", ".5",
     "\"a\"", "movej", "norm", "True", "q", "#", "sleep"]), max_size=30).map("".join))  # fmt: skip
def test_any_text_is_a_program_or_an_error_with_a_line(text):
    script = error = None
    try:
        script = parse(text)
    except ScriptError as refused:
        error = refused
    assert script.body or script.name if error is None else error.line >= 1


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_written_as_they_are(value):
    assert parse(f"x = {number_text(value)}").body[0].value.value == value

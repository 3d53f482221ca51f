"""What commands and the client know of a robot from its states and messages alone: no program runs here."""

import builtins
import itertools
import os
import re
import signal
import threading
from contextlib import nullcontext
from dataclasses import replace
from time import monotonic, sleep
from types import SimpleNamespace

import numpy as np
import pytest

from kinreach.deploy import (
    Move,
    Program,
    SimulatedUR,
    _calibrate_cli,
    _client,
    _move_cli,
    _server,
    _signals,
    _simulate_cli,
)
from kinreach.deploy._motion import LineError, PoseArc
from kinreach.deploy._program import name_of_run
from kinreach.deploy._signals import SIGNALS, Interruption
from kinreach.errors import InputError, RobotError
from kinreach.kinematics import ArmKinematics, Trajectory, pose, pose_vector
from kinreach.robots import get_arm
from kinreach.robots.inside import JOINTS
from tests.deploy.conftest import connected

ARM = get_arm("ur5e")
KIN = ArmKinematics.of(ARM, base="base")
HOME = np.array(ARM.home)
MOVES = Program.of(KIN, HOME, [Move("movej", HOME + 0.01, 1.0, 2.0)])


@pytest.fixture(scope="module")
def robot():
    with SimulatedUR(ARM, rtde_port=0, script_port=0) as served:
        yield served


@pytest.fixture(scope="module")
def client(robot):
    with connected(robot) as one:
        yield one


def test_where_a_program_ends_is_where_the_arm_has_to_stand(client):
    state, rng, cases = client.read(), np.random.default_rng(0), 0
    t = np.array([0.0, 0.1])
    for _ in range(5):
        end = HOME + rng.uniform(-0.02, 0.02, 6)
        line = pose_vector(KIN.fk(end))
        moves = Program.of(KIN, HOME, [Move("movej", HOME, 1.0, 2.0), Move("movej", end, 1.0, 2.0)])
        streamed = Program.of(KIN, HOME, Trajectory(JOINTS, t, np.array([HOME, end]), np.zeros((2, 6))))
        joint, off = int(rng.integers(6)), float(rng.uniform(0.011, 0.1))
        beside = end + off * np.eye(6)[joint] * rng.choice([-1, 1])
        for program in (moves, streamed):
            assert _client._miss(program, replace(state, actual_q=end + 0.0099)) == ""
            assert _client._miss(program, replace(state, actual_q=beside)) == f"{JOINTS[joint]} is {off:.3f} rad off"
        straight = SimpleNamespace(moves=[Move("movel", line, 0.5, 1.0)])
        for way, turned, far in ((1.9e-3, 0.4, False), (2.1e-3, 0.1, True), (1e-3, 0.6, True)):
            there = KIN.fk(end) @ pose(np.array([0.0, way, 0.0, 0.0, 0.0, np.radians(turned)]))
            said = f"its tool is {1e3 * way:.1f} mm and {turned:.2f}° off"
            assert _client._miss(straight, replace(state, tcp_pose=pose_vector(there))) == (said if far else "")
            cases += 1
    assert cases == 15


def test_a_robot_that_runs_or_has_another_cycle_is_not_ready(client):
    state = client.read()
    client._check_ready(MOVES, state)
    with pytest.raises(RobotError, match="runs a program already; end that one first"):
        client._check_ready(MOVES, replace(state, runtime_state=2))
    t, counted = 0.002 * np.arange(20), 0
    program = Program.of(KIN, HOME, Trajectory(JOINTS, t, np.tile(HOME, (20, 1)), np.zeros((20, 6))))
    for cycle, fits in ((0.002, True), (0.001, True), (0.0005, True), (0.008, False), (0.0015, False), (0.004, False)):
        stub = SimpleNamespace(_states=SimpleNamespace(cycle=cycle), _error=client._error)
        counted += fits
        if fits:
            _client.URClient._check_ready(stub, program, state)
            continue
        said = rf"cycles of {1000 * cycle:g} ms, and .* every 2 ms; .*resampled\({round(1 / cycle)}\)"
        with pytest.raises(RobotError, match=said):
            _client.URClient._check_ready(stub, program, state)
    assert counted == 3


def run_of(state, number=77, began=True):
    run = _client._ProgramRun(MOVES, state)
    run.number, run.began = number, began
    return run


def test_other_programs_are_told_by_their_names_and_numbers(client):
    state = client.read()
    run, own = run_of(state), name_of_run(77)
    assert [run.only_other(names) for names in ([], [own], ["other", own])] == [""] * 3
    assert run.only_other(["one", "other"]) == "ran another program, other, in place of this one"
    assert run.only_other([""]) == "ran another program, a single line, in place of this one"
    now = replace(state, run=77)
    assert [run.other_program(now, names) for names in ([], [own], ["other", own], ["other"])] == [""] * 4
    assert run.other_program(now, [own, "other"]) == "began another program, other, which ended this one"
    assert run.other_program(now, [own, ""]) == "began another program, a single line, which ended this one"
    for number, began, other in ((78, True, True), (78, False, False), (None, True, False), (77, True, False)):
        found = run_of(state, began=began).other_program(replace(state, run=number), [])
        assert found == ("began another client's program, which ended this one" if other else "")


def test_why_a_program_did_not_begin_is_said(client):
    before = replace(client.read(), run=5)
    run = run_of(before, began=False)
    for started, after, said in (
        (["other"], before, r"ran another program, other, in place of this one; the arm is at -90\.0, "),
        ([], replace(before, run=6), "ran another program in place of this one; the arm is at "),
        ([], replace(before, runtime_state=2), "ran another program in place of this one; the arm is at "),
        ([], before, r"did not begin: no remote; is it in remote control\?$"),
    ):
        script = SimpleNamespace(started=started, reason=lambda start: f"{start}no remote")
        stub = SimpleNamespace(
            _script=script, _error=client._error, _taken_over=client._taken_over, address=client.address
        )
        error = _client.URClient._not_begun(stub, run, after)
        assert re.search(f"^the robot at 127.0.0.1 {said}", str(error)), error
        assert isinstance(error, _client._TakenOverError) == ("did not begin" not in said)


def test_a_program_that_begins_a_little_later_took_the_place_of_one_that_ended_wrongly(client):
    state = replace(client.read(), run=77, runtime_state=2)
    run = run_of(state)
    stub = SimpleNamespace(_script=SimpleNamespace(started=[]), _taken_over=client._taken_over, _states=None)
    run.is_over = True
    with pytest.raises(_client._TakenOverError, match="began another program; the arm is at "):
        _client.URClient._look_for_another(stub, run)
    run = run_of(replace(state, run=9))
    with pytest.raises(_client._TakenOverError, match="began another client's program"):
        _client.URClient._look_for_another(stub, run)


def handlers():
    return {number: signal.getsignal(number) for number in SIGNALS}


@pytest.fixture
def own_handlers():
    """Handlers that raise, in place of those of the process."""

    def raises(number, frame):
        raise KeyboardInterrupt(number)

    before = {number: signal.signal(number, raises) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_only_the_first_of_some_signals_interrupts_and_only_once(own_handlers):
    """At once where it is armed; else where it is asked for, or at the end."""

    def interrupts(steps):
        """Which of some steps are interrupted: "check", the number of a signal, or one in a tuple for an armed one."""
        came = []
        try:
            with Interruption() as interruption:
                for step in steps:
                    armed = isinstance(step, tuple)
                    try:
                        with interruption.armed() if armed else nullcontext():
                            if step == "check":
                                interruption.check()
                            else:
                                signal.raise_signal(step[0] if armed else step)
                    except KeyboardInterrupt:
                        came.append(step)
        except KeyboardInterrupt:
            came.append("end")
        return came

    tried = 0
    for first, second in itertools.product(map(int, SIGNALS), map(int, SIGNALS)):
        assert interrupts(["check", (first,), (second,), second, "check"]) == [(first,)]
        assert interrupts([first, second, "check", (second,), "check"]) == ["check"]
        assert interrupts(["check", first, second]) == ["end"]
        tried += 1
    assert tried == 9


def test_a_signal_while_handlers_are_replaced_leaves_those_of_before(own_handlers, monkeypatch):
    """Whichever handler is not yet replaced, or put back, as it comes; and all of them are put back."""
    replacing, before, came = signal.signal, handlers(), 0
    for fails_at in range(1, 7):
        calls = itertools.count(1)

        def interrupted(number, handler, *, calls=calls, fails_at=fails_at):
            if next(calls) == fails_at:
                raise KeyboardInterrupt(fails_at)
            return replacing(number, handler)

        inside = False
        with monkeypatch.context() as patched:
            patched.setattr(_signals.signal, "signal", interrupted)
            with pytest.raises(KeyboardInterrupt, match=str(fails_at)), Interruption():
                inside = True
        assert inside == (fails_at > 3)
        assert handlers() == before
        came += 1
    assert came == 6


def test_lines_that_nobody_reads_are_left_out_and_counted(monkeypatch):
    """Those before are printed in their order; the count begins anew after it was said."""
    monkeypatch.setattr(_simulate_cli, "MAX_LINES", 4)
    printed, goes, waits = [], threading.Event(), threading.Event()

    def slow(text):
        waits.set()
        assert goes.wait(10.0)
        printed.append(text)

    monkeypatch.setattr(_simulate_cli, "say", slow)
    monkeypatch.setattr(_simulate_cli.sys, "stdout", None)
    log = _simulate_cli._Log()
    log.add("first")
    assert waits.wait(10.0)  # it is being printed, so that four others may wait
    for number in range(9):
        log.add(f"line {number}")
    goes.set()
    deadline = monotonic() + 10.0
    while len(printed) < 6 and monotonic() < deadline:
        sleep(0.001)
    log.add("last")
    log.close()
    said = "5 lines are left out here, since nobody read them"
    assert printed == ["first", *(f"line {number}" for number in range(4)), said, "last"]
    assert log._left_out == 0
    assert not log._thread.is_alive()


def test_a_log_that_is_closed_says_what_it_left_out(monkeypatch):
    monkeypatch.setattr(_simulate_cli, "MAX_LINES", 2)
    printed, goes, waits = [], threading.Event(), threading.Event()
    monkeypatch.setattr(
        _simulate_cli, "say", lambda text: (waits.set(), goes.wait(10.0), sleep(0.01), printed.append(text))
    )
    monkeypatch.setattr(_simulate_cli.sys, "stdout", None)
    log = _simulate_cli._Log()
    log.add("first")
    assert waits.wait(10.0)
    for number in range(5):
        log.add(f"line {number}")
    goes.set()
    log.close()  # its end is among the lines that wait
    assert printed == ["first", "line 0", "line 1", "3 lines are left out here, since nobody read them"]


def test_lines_of_the_log_are_written_past_the_buffer(monkeypatch):
    ours, theirs = os.pipe()
    with os.fdopen(ours, "rb") as reader, os.fdopen(theirs, "w", encoding="ascii") as writer:
        monkeypatch.setattr(_simulate_cli.sys, "stdout", writer)
        log = _simulate_cli._Log()
        for text in ("protective stop: a", "an angle of 5°"):
            log.add(text)
        log.close()
        assert os.read(reader.fileno(), 1000) == b"protective stop: a\nan angle of 5\\xb0\n"


def test_enter_releases_a_protective_stop_until_the_terminal_is_closed(monkeypatch):
    ours, theirs = os.pipe()
    released = []
    with os.fdopen(ours) as reader:
        os.write(theirs, b"\n")
        monkeypatch.setattr(_simulate_cli.sys, "stdin", reader)
        monkeypatch.setattr(_simulate_cli.select, "select", lambda *given: given)
        robot = SimpleNamespace(release=lambda: (released.append(1), os.close(theirs) if len(released) == 1 else None))
        _simulate_cli._release_by_enter(robot)
    assert released == [1]


@pytest.mark.parametrize(("answer", "agreed"), [
    ("y", True), (" Y ", True), ("", False), ("n", False), ("yes", False), ("yy", False),
])  # fmt: skip
def test_only_a_y_agrees(monkeypatch, answer, agreed):
    asked = []
    monkeypatch.setattr(builtins, "input", lambda text: (asked.append(text), answer)[1])
    assert _move_cli._agreed("10.0.0.1") is agreed
    assert asked == ["Move the robot at 10.0.0.1 now? Ctrl-C stops it. [y/N] "]


def test_nobody_to_ask_is_refused(monkeypatch):
    def nobody(_):
        raise EOFError

    monkeypatch.setattr(builtins, "input", nobody)
    with pytest.raises(InputError, match="nobody answers whether the robot may move; give --yes"):
        _move_cli._agreed("10.0.0.1")


class Moved:
    """A robot that somebody moves by hand: a state for each posture, and Ctrl-C or nothing new after the last."""

    def __init__(self, state, postures, offset=(0, 0, 0.1, 0, 0, 0)):
        self.opened, self.state, self.offset = [], state, offset
        self.postures = iter(postures)

    def __call__(self, address, **ports):
        self.opened.append((address, ports))
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.opened.append("closed")

    def next_state(self):
        q = next(self.postures)
        if q is None:
            raise KeyboardInterrupt
        offset = None if self.offset is None else np.array(self.offset, dtype=float)
        return replace(self.state, actual_q=q, tcp_pose=pose_vector(KIN.fk(q)), tcp_offset=offset)


def test_postures_that_are_apart_are_kept_while_an_owner_moves_a_robot(client, monkeypatch, capsys):
    """Apart from all before, by more than 0.25 rad in some joint."""
    rng, kept = np.random.default_rng(3), []
    way = [HOME]
    for _ in range(60):
        way.append(way[-1] + rng.uniform(-0.2, 0.2, 6))
    way = [*way, *way[:20]]
    for q in way:
        if all(np.abs(q - other).max() > 0.25 for other in kept):
            kept.append(q)
    assert 8 < len(kept) < 60
    for wanted, offset in ((8, (0, 0, 0.1, 0, 0, 0)), (len(kept) + 5, None)):
        moved = Moved(client.read(), [*way, None], offset)
        monkeypatch.setattr(_calibrate_cli, "URClient", moved)
        pairs = _calibrate_cli._read("10.0.0.1", "7,8", wanted)
        assert moved.opened == [("10.0.0.1", {"rtde_port": 7, "script_port": 8}), "closed"]
        np.testing.assert_array_equal(pairs.q, kept[:wanted])
        np.testing.assert_allclose(pairs.seen, KIN.fk(np.array(kept[:wanted])), atol=1e-9)
        count = min(wanted, len(kept))
        assert list(pairs.places) == [f"posture {number}" for number in range(1, count + 1)]
        out = capsys.readouterr().out.splitlines()
        assert f"10.0.0.1: move the arm, by hand or by a program, to {wanted} postures in which" in out[0]
        rows = np.array([[float(word) for word in line.split()] for line in out[1 : count + 1]])
        np.testing.assert_allclose(rows[:, 0], np.arange(1, count + 1))
        np.testing.assert_allclose(rows[:, 1:], np.degrees(kept[:wanted]), atol=0.051)
        assert out[count + 1 :] == ([f"{count} postures read"] if wanted > count else [])
        if offset is None:
            assert pairs.tcp is None
        else:
            np.testing.assert_allclose(
                pairs.tcp, np.tile(pose(np.array(offset, dtype=float)), (count, 1, 1)), atol=1e-12
            )


def test_a_robot_that_is_not_moved_is_given_up(client, monkeypatch):
    monkeypatch.setattr(_calibrate_cli, "URClient", Moved(client.read(), itertools.repeat(HOME, 200)))
    monkeypatch.setattr(_calibrate_cli, "monotonic", itertools.count(0.0, 1.0).__next__)
    with pytest.raises(RobotError, match=r"10.0.0.1 has not moved to another posture for 120 s: 1 read"):
        _calibrate_cli._read("10.0.0.1", "7,8", 5)


def test_a_robot_that_is_moved_now_and_then_is_not_given_up(client, monkeypatch):
    """The 120 s begin anew with each posture."""
    way = [HOME + 0.3 * number for number in range(4) for _ in range(80)]
    monkeypatch.setattr(_calibrate_cli, "URClient", Moved(client.read(), way))
    monkeypatch.setattr(_calibrate_cli, "monotonic", itertools.count(0.0, 1.0).__next__)
    assert len(_calibrate_cli._read("10.0.0.1", "7,8", 4)) == 4


@pytest.mark.parametrize("is_fixed", [False, True])
def test_an_arc_is_a_circle_through_its_three_points(is_fixed):
    """With a fixed orientation the tool turns with the circle; else evenly to the end's."""
    rng, long = np.random.default_rng(7), 0
    for _ in range(10):
        start, end = (pose(rng.uniform(-0.5, 0.5, 6)) for _ in range(2))
        via = rng.uniform(-0.5, 0.5, 3)
        arc = PoseArc(start, via, end, is_fixed=is_fixed)
        shares = np.linspace(0.0, 1.0, 80)
        poses = np.array([arc.at(share) for share in shares])
        points = poses[:, :3, 3]
        np.testing.assert_allclose(poses[0], start, atol=1e-9)
        np.testing.assert_allclose(points[-1], end[:3, 3], atol=1e-9)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
        assert np.linalg.norm(points - via, axis=1).min() < 0.51 * steps[0]
        assert arc.length == pytest.approx(steps.sum(), rel=1e-3)
        if is_fixed:
            chords = np.diff(points, axis=0)  # as the tool sees them, they point the same way all along
            seen = np.einsum("nji,nj->ni", poses[:-1, :3, :3], chords) / steps[:, None]
            np.testing.assert_allclose(seen, np.broadcast_to(seen[0], seen.shape), atol=1e-6)
        else:
            np.testing.assert_allclose(poses[-1], end, atol=1e-9)
        long += arc.turned > np.pi
    assert 1 < long < 10
    for along in (0.3, 0.5, 2.0, -1.0):
        with pytest.raises(LineError, match="movec needs three points that are not on a line"):
            PoseArc(start, start[:3, 3] + along * (end[:3, 3] - start[:3, 3]), end, is_fixed=is_fixed)


def test_the_longest_of_unfinished_programs_is_dismissed_if_all_are_too_long():
    rng, most, dismissed = np.random.default_rng(0), _server.MAX_UNFINISHED, 0

    class Sender(_server._ScriptClient):
        def __init__(self, length):
            self.program, self.why = range(length), []

        def dismiss(self, why):
            self.why.append(why)

    for beyond in (0, 1, 1000, -1000):
        first, second = rng.integers(1, most // 2, 2).tolist()
        senders = [Sender(length) for length in (first, second, most + beyond - first - second)]
        _server.SimulatedUR.check_unfinished(SimpleNamespace(_clients=senders))
        longest = max(senders, key=lambda each: len(each.program))
        for each in senders:
            too_long = beyond > 0 and each is longest
            assert each.why == (["the unfinished programs are too long"] if too_long else [])
            dismissed += too_long
    assert dismissed == 2


@pytest.mark.parametrize(("text", "told"), [
    ("protective stop: it touches", [(_server.KEY, "Protective stop", "protective stop: it touches")]),
    ("emergency stop: by hand", [(_server.KEY, "Emergency stop", "emergency stop: by hand")]),
    ("program stopped: no reason", [(_server.RUNTIME_EXCEPTION, "", "program stopped: no reason")]),
    ("program f is running", []),
])  # fmt: skip
def test_stops_are_told_to_the_clients_and_all_is_logged(text, told):
    for has_log in (True, False):
        log, clients = [], []
        _server.SimulatedUR._log(
            SimpleNamespace(_tell=log.append if has_log else None, _tell_clients=clients.append), text
        )
        assert log == ([text] if has_log else [])
        assert clients == [_server.Message(*each) for each in told]

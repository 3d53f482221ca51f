"""The part "Move": what is planned on the page is what `kinreach move` plans, and what is copied gives exactly that."""

import re
import shlex
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from kinreach.cli import main
from kinreach.deploy import SimulatedUR
from kinreach.deploy.inside import MotionFlags
from kinreach.kinematics import ArmKinematics, CollisionChecker, pose_vector
from kinreach.robots import get_arm
from kinreach.view import _cli
from kinreach.view._cli import setup_of

pytest.importorskip("viser")

from benchmarks.studies.tab import Tab, wait_for
from kinreach.view._draw import FAR
from kinreach.view._server import Server

GOAL, BOX = "-0.4,0.3,0.3,3.14,0,0", "-0.2,-0.2,0.4,0.1,0.1,0.8"
#: A box in nobody's way.
ASIDE = "0.6,0.6,0.1,0.1,0.1,0.1"
KIN = ArmKinematics.of("ur5e", base="base")
#: A short way from the start posture.
NEAR = ",".join(map(str, pose_vector(KIN.fk(np.add(KIN.arm.home, 0.15))).round(4).tolist()))


@pytest.fixture(scope="module")
def server():
    serving = Server(setup_of("ur5e", simple=True), port=8560)
    yield serving
    serving.stop()


@pytest.fixture
def tab(server):
    with Tab(server) as opened:
        opened.press("Move")
        wait_for(lambda: opened.part == "Move")
        yield opened


def planned(tab, *, still=True):
    """The motion after a press on the button."""
    panel, before = tab.page.shown, tab.page.shown.shown
    tab.set("Plan", True)
    wait_for(lambda: panel.shown is not before or "kr-wrong" in panel._verdict.content)
    with tab.page.lock:  # until all of it is drawn, and it plays
        assert panel.shown is not before, panel._verdict.content
    if still:
        tab.set("player", "pause")
        wait_for(lambda: not panel.playing)
    return panel.shown


def copied(tab, kind):
    """What a button of "copy as" shows."""
    tab.set("copy as", kind)
    wait_for(lambda: any(element.get("title") == f"This motion as {kind}" for element in tab.elements.values()))
    text = tab.page.shown.text(kind)
    wait_for(lambda: any("kinreach-code" in element.get("content", "") for element in tab.elements.values()))
    tab.set("Close", True)
    return text


#: Inputs of the page, and what of the flags they are.
INPUTS = [
    {"goal": GOAL},
    {"goal": f"p[{GOAL}]", "boxes": BOX},
    {"goal": f"{GOAL}; {NEAR}", "blend [mm]": 20.0, "speed [%]": 40.0},
    {"goal": NEAR, "tool on straight lines": True, "table [m]": "-0.1", "start": "-80, -90, 90, -90, -90, 10"},
    {"goal": GOAL, "branch": "same", "turn at most [°]": 90.0, "table and floor": False},
    {"goal": GOAL, "meshes": f"PILLAR@{BOX[:13]},0,0,0", "mesh scale": 0.001},
]


@pytest.fixture(scope="module")
def pillar(tmp_path_factory):
    """The box `BOX` as a mesh in millimetres."""
    file = tmp_path_factory.mktemp("meshes") / "pillar.stl"
    trimesh.creation.box(1000 * np.array(BOX.split(",")[3:], dtype=float)).export(file)
    return str(file)


@pytest.mark.parametrize("inputs", INPUTS)
@pytest.mark.slow
def test_what_is_copied_gives_the_motion_that_is_shown(tab, inputs, pillar, tmp_path, capsys):
    """The command writes the same program by `--script`, and so does the Python code."""
    inputs = {name: value.replace("PILLAR", pillar) if name == "meshes" else value for name, value in inputs.items()}
    for label, value in inputs.items():
        tab.set(label, value)
    wait_for(lambda: all(tab.state_at_server(tab.element(name))["value"] == value for name, value in inputs.items()))
    shown = planned(tab)
    script, file = copied(tab, "URScript"), tmp_path / "motion.script"
    words = shlex.split(copied(tab, "command").replace("\\\n", " "))
    assert words[:2] == ["kinreach", "move"]
    capsys.readouterr()
    assert main([*words[1:], "--script", str(file)]) == 0
    assert file.read_text() == script == shown.motion.program.text
    for line in capsys.readouterr().out.splitlines():
        if line.startswith(("dry run", "         no collision")):
            assert " ".join(line.split()) in tab.text
    exec(compile(copied(tab, "Python"), "copied", "exec"), {})
    assert capsys.readouterr().out == script


@pytest.mark.slow
def test_a_motion_is_played_and_scrubbed_along_its_time(tab):
    tab.set("goal", GOAL)
    shown = planned(tab, still=False)
    panel, commanded = tab.page.shown, shown.motion.done.commanded
    wait_for(lambda: panel.at == panel.last and not panel.playing)  # it plays by itself
    assert tab.element("time [s]")["max"] >= commanded.duration
    seen = 0
    for time in np.linspace(0.0, commanded.duration, 6):
        tab.set("time [s]", float(round(time, 2)))
        wait_for(lambda time=time: abs(shown.times[panel.at] - time) <= 0.5 / 25 + 0.005)
        with tab.page.lock:
            q, qd = (part for part in commanded.at(shown.times[panel.at]))
            np.testing.assert_array_equal(panel.q, q)
            np.testing.assert_allclose(
                shown.shares[panel.at], np.abs(qd) / shown.motion.kinematics.velocity_limit, atol=1e-12
            )
        seen += 1
    assert seen == 6
    tab.set("player", "start")
    wait_for(lambda: panel.at == 0)
    np.testing.assert_allclose(panel.q, get_arm("ur5e").home, atol=1e-9)


@pytest.mark.slow
def test_a_mesh_is_drawn_and_avoided(tab, pillar):
    """A pillar as a mesh in millimetres is where the same pillar as a box is, and has the same caution."""
    tab.set("mesh scale", 0.001)
    tab.set("meshes", f"{pillar}@{BOX[:13]},0,0,0")
    wait_for(lambda: "/move/world/pillar.stl" in tab.nodes)
    corners = tab.nodes["/move/world/pillar.stl"]["vertices"].reshape(-1, 3)
    centre, half = (KIN.T_world_base @ [-0.2, -0.2, 0.4, 1])[:3], np.array([0.05, 0.05, 0.4])
    np.testing.assert_allclose(corners.min(axis=0), centre - half, atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), centre + half, atol=1e-6)
    tab.set("goal", GOAL)
    shown = planned(tab)
    assert shown.motion.cautions[0].startswith("the arm leaves its branch: from 6 (right, up, straight) to ")
    wait_for(lambda: "no collision with itself, table, floor, pillar.stl" in tab.text)
    exact = CollisionChecker(KIN, obstacles=[*KIN.arm.workcell.obstacles, *shown.motion.meshes], margin=0.0049)
    assert all(exact.free(q) for q in shown.q)
    tab.set("meshes", "")
    wait_for(lambda: "/move/world/pillar.stl" not in tab.nodes and "plan again" in tab.text)


@pytest.mark.slow
def test_the_chart_has_the_speeds_over_the_time_and_a_press_on_it_goes_there(tab):
    tab.set("goal", f"{GOAL}; {NEAR}")
    shown, panel = planned(tab), tab.page.shown
    commanded = shown.motion.done.commanded
    chart = panel._chart.content
    wait_for(lambda: chart in tab.text)
    top = float(re.search(r"<span>([\d.]+) %", chart)[1]) / 100
    lines = re.findall('<polyline points="([^"]*)"', chart)
    assert len(lines) == 6
    corners = [np.array([pair.split(",") for pair in line.split()], dtype=float) for line in lines]
    assert min(map(len, corners)) < 40  # straight parts have no corners
    shares = np.abs(commanded.qd) / shown.motion.kinematics.velocity_limit
    assert shares.max() <= top <= 2 * shares.max()
    for joint, line in enumerate(corners):
        drawn = np.interp(1000 * commanded.t / commanded.duration, *line.T) / 100 * top
        np.testing.assert_allclose(drawn, shares[:, joint], atol=0.02 * top)
    for at in (0, 37, 100):
        tab.set("moment", str(at))
        wait_for(lambda at=at: panel.at == round(panel.last * at / 100) and not panel.playing)
        wait_for(lambda: f"--kr-moment: {shown.times[panel.at] / shown.times[-1]:.4f}" in tab.text)


@pytest.mark.slow
def test_what_is_typed_around_the_arm_is_drawn_and_asks_for_a_new_plan(tab):
    tab.set("goal", NEAR)
    shown, panel = planned(tab), tab.page.shown
    assert "/move/world/box 1" not in tab.nodes
    tab.set("boxes", ASIDE[:9])  # not yet a box
    tab.set("boxes", ASIDE)
    wait_for(lambda: "/move/world/box 1" in tab.nodes and "plan again" in tab.text)
    tab.set("boxes", "")
    wait_for(lambda: "/move/world/box 1" not in tab.nodes and "plan again" not in tab.text)
    tab.set("table and floor", False)
    wait_for(lambda: "/move/world/table" not in tab.nodes and "plan again" in tab.text)
    assert planned(tab) is not shown
    wait_for(lambda: "plan again" not in tab.text)
    assert panel.shown.arm.workcell.obstacles == ()


def test_the_shade_is_the_arm_along_its_way(tab):
    """Between start and goal, at even distances; the lines end at the tool in the start posture and at the goal."""
    tab.set("goal", GOAL)
    shown = planned(tab)
    places = shown.along(12)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() < 1.02 * steps.min()
    assert np.linalg.norm(shown.q[0] - places[0]) == pytest.approx(steps.mean(), rel=0.02)
    kin = ArmKinematics.of("ur5e", base="world")
    wait_for(lambda: "/move/shades/way_of_the_tip" in tab.nodes)
    line = tab.nodes["/move/shades/way_of_the_tip"]["points"].reshape(-1, 3)
    np.testing.assert_allclose(line[0], kin.fk(shown.q[0])[:3, 3], atol=1e-6)
    np.testing.assert_allclose(line[-1], kin.fk(shown.q[-1])[:3, 3], atol=1e-6)
    batch = next(node for name, node in tab.nodes.items() if name.startswith("/move/shades/0"))
    assert np.abs(batch["batched_positions"]).max() < FAR
    assert tab.element("shade of the way")["value"] is True
    tab.set("shade of the way", False)
    wait_for(lambda: tab.nodes["/move/shades"]["visible"] is False)


@pytest.mark.slow
def test_a_caution_is_in_the_first_line(tab):
    tab.set("goal", GOAL)
    planned(tab)
    wait_for(
        lambda: "No joint turns by more than 38°, and the arm stays in its branch: 6 (right, up, straight)." in tab.text
    )
    tab.set("boxes", BOX)
    shown = planned(tab)
    assert shown.motion.cautions
    (caution,) = shown.motion.cautions
    wait_for(lambda: f'kr-caution">Caution: {caution}.' in tab.text)
    assert caution.startswith("the arm leaves its branch: from 6 (right, up, straight) to ")


@pytest.mark.parametrize(
    ("label", "value", "said"),
    [
        ("goal", "1,2,3", "goal must be 6 numbers"),
        ("start", "0,0", "start must be 6 numbers"),
        ("table [m]", "0.2", "--table must be 0 or negative"),
        ("boxes", "-0.4,0.3,0.3,0.3,0.3,0.3", "goal"),
        ("meshes", "nothing.stl", "nothing.stl"),
        ("turn at most [°]", 1.0, "a joint"),
        ("goal", "-0.4,0.3,0.3,180,0,0", "are in radians, not degrees"),
        ("goal", "-400,300,300,3.14,0,0", "positions are in metres"),
        ("boxes", "0,0,1", "--box must be 6 numbers"),
        ("meshes", "nothing.stl@1,2", "--mesh must be 6 numbers"),
    ],
)
@pytest.mark.slow
def test_what_cannot_be_planned_is_said_and_the_last_motion_stays(tab, label, value, said):
    tab.set("goal", GOAL)
    shown, panel = planned(tab), tab.page.shown
    tab.set(label, value)
    tab.set("Plan", True)
    wait_for(lambda: "kr-wrong" in tab.text and said in tab.text)
    assert panel.shown is shown
    wait_for(lambda: not tab.element("Plan")["disabled"])


@pytest.mark.slow
def test_goal_and_start_are_taken_from_what_is_shown(tab):
    """The arrows, the target of the part "Target", and the posture on the screen."""
    panel = tab.page.shown
    kin = ArmKinematics.of("ur5e", base="base")
    tab.drag("/move/goal", np.array([0.3, 0.4, 0.5]))
    T = np.linalg.inv(kin.T_world_base)
    there = T[:3, :3] @ (0.3, 0.4, 0.5) + T[:3, 3]
    wait_for(lambda: np.abs(MotionFlags((panel._goal.value,)).goals[0][:3, 3] - there).max() < 1e-4)
    before = tab.page.target.T.copy()
    before[:3, 3] += (0.0, 0.05, -0.1)
    tab.page.target.move(before)
    tab.set("Take the goal from Target", True)
    wait_for(lambda: np.abs(MotionFlags((panel._goal.value,)).goals[0] - T @ before).max() < 2e-4)
    tab.set("goal", GOAL)
    shown = planned(tab)
    tab.set("time [s]", 0.6)
    wait_for(lambda: abs(shown.times[panel.at] - 0.6) < 1e-9)
    tab.set("Start from the posture shown", True)
    wait_for(lambda: panel._from.value != "home")
    again = planned(tab)
    np.testing.assert_allclose(again.motion.start, shown.q[15], atol=np.radians(0.006))


class Standin:
    """A server that shows nothing."""

    address = "http://127.0.0.1:8123"

    def __init__(self, setup, *, port):
        self.setup = setup
        SEEN.append(setup)

    def stop(self):
        SEEN.append("stopped")


SEEN = []


@pytest.fixture
def no_browser(monkeypatch):
    monkeypatch.setattr(_cli, "Server", Standin)
    monkeypatch.setattr(_cli.webbrowser, "open", SEEN.append)
    SEEN.clear()


def test_show_opens_the_page_with_the_motion(no_browser, monkeypatch, capsys):
    """Of an arm with a tool; it is served until Ctrl-C, and the page has the words that were typed."""

    class Waiting:
        def wait(self):
            raise KeyboardInterrupt

    monkeypatch.setattr("kinreach.deploy._move_cli.threading", SimpleNamespace(Event=Waiting))
    given = ["--arm", "ur5e", "--tool", "0,0,0.15,0,0,0", "--tool-radius", "0.04"]
    asked = ["--to", GOAL, "--branch", "right, up", "--box", ASIDE, "--max-travel", "200", "--degrees"]
    assert main(["move", *given, *asked, "--show"]) == 130
    setup, opened, stopped = SEEN
    assert (opened, stopped) == (Standin.address, "stopped")
    assert setup.first == "Move"
    assert setup.words == tuple(given)
    assert setup.motion.flags == MotionFlags((GOAL,), None, True, "right, up", "200", boxes=(ASIDE,))
    out = capsys.readouterr().out
    assert f"page     {Standin.address}  (only on this machine" in out
    assert all(" ".join(line.split()) in " ".join(out.split()) for line in setup.motion.remarks)


@pytest.mark.parametrize("answer", ["n", "y"])
def test_a_robot_is_asked_about_after_its_motion_is_shown(answer, no_browser, monkeypatch, capsys):
    """Nothing is sent before the answer; what is shown begins where the robot stands."""
    questions = []

    def asked(text):
        questions.append([type(entry).__name__ for entry in SEEN])
        return answer

    monkeypatch.setattr("builtins.input", asked)
    with SimulatedUR("ur5e", rtde_port=0, script_port=0, log=(log := []).append) as robot:
        ports = f"{robot.rtde_port},{robot.script_port}"
        move = ["move", "--arm", "ur5e", "--to", NEAR, "--robot", "127.0.0.1", "--ports", ports, "--show"]
        assert main([*move, "--yes"]) == 2
        assert "leave out --yes" in capsys.readouterr().err
        assert SEEN == []
        assert main(move) == (1 if answer == "n" else 0)
    assert questions == [["Setup", "str"]]
    shown = SEEN[0].motion
    assert shown.sends
    np.testing.assert_array_equal(shown.flags.posture(ArmKinematics.of("ur5e", base="base")), shown.motion.start)
    out = capsys.readouterr().out
    assert ("nothing was sent" in out, "moved    " in out) == (answer == "n", answer == "y")
    assert bool(log) == (answer == "y")


@pytest.mark.slow
def test_a_page_that_is_opened_with_a_motion_shows_it(capsys):
    from dataclasses import replace

    from kinreach.view._motion import ShownMotion

    flags = MotionFlags((NEAR,), branch="right", max_travel="3.1", speed=0.4)
    setup = setup_of("ur5e", simple=True)
    arm = flags.surrounded(setup.arm)
    planner = flags.planner(arm)
    motion = planner.tried(flags.posture(planner.kinematics))
    serving = Server(replace(setup, motion=ShownMotion(flags, motion, sends=True)), port=8570)
    try:
        with Tab(serving) as tab:
            wait_for(lambda: tab.part == "Move")
            panel = tab.page.shown
            assert panel.shown.motion is motion
            assert tab.element("branch")["value"] == "right"
            assert tab.element("speed [%]")["value"] == 40
            wait_for(lambda: "nothing is sent from here" in tab.text)
            again = planned(tab)
            assert again.motion.program.text == motion.program.text
            assert not again.sends
    finally:
        serving.stop()

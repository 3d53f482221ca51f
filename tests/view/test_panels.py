"""The parts of the page on a real server, with a tab that has no browser."""

import contextlib
import gc
import html
import json
import re
import threading
import weakref
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from kinreach._registration import BUTTON, MOVING, OBSTACLES, REAL_ARM, SINGLE
from kinreach._rotations import placement
from kinreach.kinematics import ArmKinematics
from kinreach.robots import PUBLISHED_CALIBRATIONS, Tool
from kinreach.view._cli import setup_of

pytest.importorskip("viser")

from benchmarks.studies.tab import Tab, wait_for
from kinreach.robots import arm_names, get_arm
from kinreach.view._draw import RED
from kinreach.view._episodes import EpisodeRequest
from kinreach.view._inputs import TypedInput, by_user
from kinreach.view._names import plain
from kinreach.view._page import panels
from kinreach.view._panel import Panel
from kinreach.view._server import Server
from kinreach.view._target import State


@pytest.fixture(scope="module")
def serve():
    """`serve(arm, ...)`: a server of an arm, drawn simply; one for all tests that ask for the same."""
    with contextlib.ExitStack() as stack:
        servers = {}

        def serving(arm, calibration=None):
            if (arm, calibration) not in servers:
                servers[arm, calibration] = Server(setup_of(arm, calibration=calibration, simple=True), port=8460)
                stack.callback(servers[arm, calibration].stop)
            return servers[arm, calibration]

        yield serving


CALIBRATION = str(PUBLISHED_CALIBRATIONS["ur5_a"])


def test_two_tabs_have_targets_of_their_own(serve):
    server = serve("ur5-thesis")
    with Tab(server) as one, Tab(server) as other:
        targets = [tab.page.target for tab in (one, other)]
        before = [panel.T.copy() for panel in targets]
        said = targets[1].answer
        one.drag("/target/goal", before[0][:3, 3] + (0.05, 0.02, -0.03))
        wait_for(lambda: np.abs(targets[0].T - before[0]).max() > 0.01)
        np.testing.assert_allclose(targets[0].T[:3, 3] - before[0][:3, 3], (0.05, 0.02, -0.03), atol=1e-12)
        np.testing.assert_array_equal(targets[1].T, before[1])
        assert targets[1].answer is said
    wait_for(lambda: not server.pages)


@pytest.mark.slow
def test_another_arm_is_chosen_in_the_page(serve):
    """It begins anew, with what the arm has; the first arm comes back as it was given, and a name only is taken."""
    with Tab(serve("ur5", CALIBRATION)) as tab:
        first, names = tab.page.target.model.kinematics, tab.element("arm")["options"]
        assert names[0] == first.arm.name == "ur5_calibrated"
        assert set(names) == {first.arm.name, *arm_names()}
        for arm, joints, parts in (
            ("panda", 7, {"Target", "Episodes", "Results"}),
            ("so101", 5, {"Target", "Episodes", "Results"}),
            ("ur5_calibrated", 6, {"Target", "Move", "Real arm", "Episodes", "Results"}),
        ):
            tab.set("arm", arm)
            wait_for(lambda arm=arm: shown_arm(tab) == arm)
            wait_for(lambda arm=arm: tab.element("arm")["value"] == arm)
            assert (tab.page.target.model.kinematics.n, set(tab.page.names)) == (joints, parts)
            assert tab.page.trouble == ""
        assert tab.page.target.model.kinematics.arm == first.arm
        tab.set("arm", "ur9")
        wait_for(lambda: "ur9" in tab.page.trouble)
        assert tab.page.target.model.kinematics.arm == first.arm


def shown_arm(tab):
    with tab.page.lock:
        return tab.page.target.model.kinematics.arm.name


def test_the_real_arm_is_a_part_with_a_tool_too():
    for calibration in (None, CALIBRATION):
        setup = setup_of("ur5", calibration=calibration, tool=Tool([0, 0, 0.1, 0, 0, 0]))
        assert "Real arm" in panels(setup)


def test_what_is_out_of_reach_is_not_said_to_be_free_to_move(serve):
    with Tab(serve("ur5-thesis")) as tab:
        wait_for(lambda: "free to move" in tab.text)
        T = tab.page.target.T
        tab.set("x y z [m]", (2.0, 0.0, 0.3))
        wait_for(lambda: "No posture reaches" in tab.text and "free to move" not in tab.text)
        tab.set("x y z [m]", tuple(T[:3, 3].tolist()))
        wait_for(lambda: "free to move" in tab.text)


def test_a_table_that_is_touched_is_red_with_its_legs(serve):
    with Tab(serve("ur5-thesis")) as tab:
        names = ["/world/table", *(f"/world/table/leg_{index}" for index in range(4))]
        wait_for(lambda: set(names) <= set(tab.nodes))
        surroundings = tab.page._surroundings
        before = [node.color for _, node in surroundings._boxes["table"]]
        assert len(before) == len(names)
        surroundings.mark(["table"])
        assert {node.color for _, node in surroundings._boxes["table"]} == {RED}
        surroundings.mark([])
        assert [node.color for _, node in surroundings._boxes["table"]] == before


def test_what_is_typed_is_not_rewritten(serve):
    """On the way to -0.2 there is -0, which is 0 already."""
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.target
        wait_for(lambda: tab.element("x y z [m]")["value"][1] == pytest.approx(panel.T[1, 3], abs=1e-3))
        tab.set("x y z [m]", (0.4, 0.2, 0.3))
        wait_for(lambda: panel.T[1, 3] == 0.2)
        tab.set("x y z [m]", (0.4, -0.0, 0.3))
        wait_for(lambda: panel.T[1, 3] == 0.0)
        before = tab.element("roll pitch yaw [°]")["value"]
        panel.move(panel.T @ np.diag([1.0, -1.0, -1.0, 1.0]))
        wait_for(lambda: tab.element("roll pitch yaw [°]")["value"] != before)  # all before it has arrived, too
        assert np.signbit(tab.element("x y z [m]")["value"][1])


@pytest.mark.parametrize("what", ["position", "joint"])
def test_what_is_typed_while_an_answer_is_drawn_is_kept(serve, what):
    """The answer to a number comes when the next one has been typed."""
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.target
        label, first, second = {
            "position": ("x y z [m]", (0.4, 0.2, 0.3), (0.4, 0.2, 0.35)),
            "joint": ("shoulder pan [°]", -80.0, -70.0),
        }[what]
        answer, element, seen = panel.model.answer, tab.element(label), []

        def value():
            return tab.state_at_server(element)["value"]

        def slow(goal, seed):
            seen.append(value())
            if len(seen) == 1:
                tab.set(label, second)
                wait_for(lambda: value() == second)
            return answer(goal, seed)

        panel.model.answer = slow
        tab.set(label, first)
        wait_for(lambda: len(seen) == 2)
        with tab.page.lock:
            assert seen == [first, second]
            assert value() == second
            reached = panel.T[2, 3] if what == "position" else np.degrees(panel.q[0])
            assert reached == pytest.approx(0.35 if what == "position" else -70.0)


@pytest.mark.slow
def test_solvers_start_where_they_are_told_to(serve):
    """From the start posture they need steps to get to where the arm stands already; the closed form never does."""
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.target
        panel.move(panel.T + np.array([[0, 0, 0, 0.05], [0, 0, 0, 0.1], [0, 0, 0, 0.1], [0, 0, 0, 0]]))
        assert np.abs(panel.q - panel.model.home).max() > 0.05
        wait_for(lambda: "from the start posture -90° -90°" in tab.text)
        tab.set("Solve", True)
        wait_for(lambda: panel.finishes)
        iterations = {finish.solver: finish.result.iterations for finish in panel.finishes}
        assert min(iterations[name] for name in ("placo", "lm", "qp")) > 1
        tab.set("Start them from this posture", True)
        wait_for(lambda: "from the posture" in tab.text)
        before = panel.finishes
        tab.set("Solve", True)
        wait_for(lambda: panel.finishes is not before)
        after = {finish.solver: finish.result.iterations for finish in panel.finishes}
        assert max(after[name] for name in ("placo", "lm", "qp")) <= 1
        tab.set("Back to the start", True)
        wait_for(lambda: "from the start posture" in tab.text)


def test_a_target_that_is_dragged_is_answered(serve):
    with Tab(serve("ur5-thesis")) as tab:
        panel, rng, answers = tab.page.target, np.random.default_rng(0), 0
        for _ in range(10):
            position = panel.T[:3, 3] + rng.uniform(-0.1, 0.1, 3)
            panel.draw_s = 0.0
            tab.drag("/target/goal", position)
            wait_for(lambda: panel.draw_s > 0)
            np.testing.assert_allclose(panel.answer.goal.T[:3, 3], position, atol=1e-12)
            wait_for(lambda: panel.answer.verdict in tab.text)
            answers += 1
        assert answers == 10


def test_a_pose_whose_postures_are_a_surface_has_no_curves_to_choose_from(serve):
    with Tab(serve("panda")) as tab:
        panel = tab.page.target
        motions = panel.model.kinematics.self_motions(panel.T)
        wait_for(lambda: panel._motion._curves)
        with tab.page.lock:
            panel._motion.show(replace(motions, curves=[], surfaces=[motions[0].q]))
            assert panel._motion.take() is None
            wait_for(lambda: "are a surface, not curves" in tab.text)  # the page would draw its own curves again


def test_the_self_motion_of_a_seven_axis_arm(serve, monkeypatch):
    """Lines of the elbow, and a slider that moves the arm on a curve while the tool stands still."""
    with Tab(serve("panda")) as tab:
        panel, states = tab.page.target, []
        kin, label = panel.model.kinematics, "along it [rad]"
        curves = kin.self_motions(panel.T).curves
        names = tab.element("curve")["options"]
        assert len(names) == len(curves) > 1
        assert all(f"{curve.total:.1f} rad, ends at" in name for curve, name in zip(curves, names, strict=True))
        lines = tab.nodes["/target/self_motion/all"]["points"].reshape(-1, 2, 3)
        assert len(lines) == sum(len(curve.q) - 1 for curve in curves)
        shoulder = (0.0, 0.0, 0.333)  # the elbow is as far from it as the links are long
        np.testing.assert_allclose(np.linalg.norm(lines - shoulder, axis=2), np.hypot(0.316, 0.0825), atol=1e-6)
        for name, curve in zip(names, curves, strict=True):
            tab.set("curve", name)
            wait_for(lambda curve=curve: tab.element(label)["max"] == pytest.approx(curve.total, abs=0.01))
            for place in np.linspace(0.0, tab.element(label)["max"], 5).tolist():
                tab.set(label, place)
                q = curve.at(min(place, curve.total))
                wait_for(lambda q=q: np.abs(panel._drawn - q).max() < 1e-9)
                with tab.page.lock:
                    posture = panel.answer.postures[panel.solid]
                    assert posture.pairs == panel.model.checker.contacts(q)
                np.testing.assert_allclose(kin.fk(posture.q), panel.T, atol=1e-6)
                states.append(posture.state)
                wait_for(
                    lambda curve=curve: len(tab.nodes["/target/self_motion/chosen"]["points"]) == 6 * len(curve.q) - 6
                )
                wait_for(lambda posture=posture: html.escape(posture.reason) in tab.text)
        assert len(states) == 5 * len(curves)
        assert set(states) == {State.USABLE, State.COLLIDES}
        tab.set("asks for", "position and direction")
        wait_for(lambda: "that of a position and orientation" in tab.text and not tab.shows(label))
        tab.set("asks for", "position and orientation")
        wait_for(lambda: tab.shows(label))
        with monkeypatch.context() as moving:
            moving.setattr(panel, "_trace", lambda: None)  # the target does not come to rest
            tab.drag("/target/goal", panel.T[:3, 3] + 0.01)
            wait_for(lambda: "when the target stands still" in tab.text and not tab.shows(label))
        tab.drag("/target/goal", (2.5, 0.0, 0.0))
        wait_for(lambda: "There is no self-motion: no posture reaches the goal." in tab.text and not tab.shows(label))
        assert not tab.nodes["/target/self_motion"]["visible"]


@pytest.mark.slow
def test_the_real_arm_beside_its_data_sheet(serve, root):
    with Tab(serve("ur5-thesis", CALIBRATION)) as tab:
        panel = tab.page.show("Real arm")
        wait_for(lambda: tab.part == "Real arm" and tab.shows("error drawn ×") and not tab.shows("asks for"))
        first = panel.miss
        assert 0.001 < first.distance < 0.01
        wait_for(lambda: f"{1000 * first.distance:.1f} mm beside the target" in tab.text)
        assert "published" not in tab.text
        tab.drag("/real_arm/goal", panel.T[:3, 3] - (0.1, 0, 0.1))
        wait_for(lambda: panel.miss is not first)
        wait_for(lambda: "&lt; 1 µm off" in tab.text)
        tab.drag("/real_arm/goal", (2.5, 0.0, 0.0))
        wait_for(lambda: "has no posture there: too far away" in tab.text)
        assert panel.miss is None
        for file, said in (("missing.yaml", "cannot read"), (str(root / "README.md"), "calibration")):
            before = panel.model
            panel.open(file)
            wait_for(lambda said=said: re.search(f"kinreach-verdict.*{said}", tab.text))
            assert panel.model is before
        panel.open(str(PUBLISHED_CALIBRATIONS["ur5_b"]))
        assert panel.miss is not None
        assert panel.model is not before
        tab.page.show("Target")
        wait_for(lambda: tab.part == "Target" and tab.shows("asks for") and not tab.shows("error drawn ×"))
        assert not tab.nodes["/real_arm"]["visible"]


@pytest.mark.slow
def test_a_calibration_says_at_the_target_what_it_changes(serve):
    """The tip's error in the data sheet's posture, at each target; of an arm without a file nothing is said."""
    with Tab(serve("ur5-thesis", CALIBRATION)) as tab:
        panel, said = tab.page.target, set()
        sheet, real = (
            ArmKinematics.of(arm, base="world") for arm in (get_arm("ur5-thesis"), panel.model.kinematics.arm)
        )
        for x in (0.0, 0.1, 0.2):
            T = sheet.fk(panel.model.home)
            T[0, 3] += x
            seed = panel.q
            panel.move(T)
            q = sheet.nearest(T, seed).q
            off = f"{1000 * np.linalg.norm(real.fk(q)[:3, 3] - T[:3, 3]):.1f} mm"
            words = "Calibrated by ur5_a.yaml: these are this arm&#x27;s own postures. In the data "
            wait_for(
                lambda words=words, off=off: f"{words}sheet&#x27;s its tip would be {off} beside the target" in tab.text
            )
            said.add(off)
        assert len(said) == 3
        tab.drag("/target/goal", (3.0, 0.0, 0.0))
        wait_for(lambda: "the data sheet&#x27;s has none here" in tab.text)
    with Tab(serve("ur5-thesis")) as tab:
        assert "Calibrated" not in tab.text


@pytest.mark.slow
def test_without_a_file_the_real_arm_is_a_published_one(serve):
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.show("Real arm")
        wait_for(lambda: "This is the published calibration ur5_a, of another ur5" in tab.text)
        assert panel.miss is not None
        assert tab.element("or a published")["options"] == ["ur5_a", "ur5_b", "ur5_c", "ur5_d"]
        tab.set("or a published", "ur5_c")
        wait_for(lambda: "This is the published calibration ur5_c" in tab.text)
        assert "ur5_c.yaml" in panel.program()
        panel.open(CALIBRATION)
        wait_for(lambda: "published" not in tab.text)
    with Tab(serve("ur16e")) as tab:
        panel = tab.page.show("Real arm")
        wait_for(lambda: "The package has none of this model" in tab.text)
        assert panel.model is None


@pytest.fixture
def without_zero(tmp_path):
    """The URDF file of an arm with joints that 0 is out of, on either side, and one that hardly moves."""
    limits = [(0.9, 2.0), (-2.5, -0.8), (1.2, 1.2001), (-1.0, 1.0)]
    links = [f'<link name="l{index}"/>' for index in range(len(limits) + 1)]
    joints = [
        f'<joint name="j{index}" type="revolute"><parent link="l{index}"/><child link="l{index + 1}"/>'
        f'<origin xyz="0.3 0 0.1"/><axis xyz="0 {index % 2} {1 - index % 2}"/>'
        f'<limit lower="{low}" upper="{high}" velocity="1" effort="1"/></joint>'
        for index, (low, high) in enumerate(limits)
    ]
    file = tmp_path / "without_zero.urdf"
    file.write_text(f'<robot name="without_zero">{"".join(links + joints)}</robot>')
    return str(file)


#: The other URs are rows of one table; sessions open the rest.
KINDS = {"panda", "ur20"}


@pytest.mark.parametrize(
    "arm",
    [*(pytest.param(arm, marks=() if arm in KINDS else pytest.mark.slow) for arm in arm_names()), "without_zero"],
)
def test_every_arm_has_a_page(arm, request, capfd):
    """With all its parts; its sliders say how it stands, and the narrowest limits are answered, too."""
    setup = setup_of(request.getfixturevalue(arm) if arm == "without_zero" else arm, simple=True)
    server = Server(setup, port=8470)
    try:
        with Tab(server) as tab:
            for part, kind in panels(setup).items():
                assert type(tab.page.show(part)) is kind
            target = tab.page.show("Target")
            for joint, q in zip(setup.arm.joints, np.degrees(target.q), strict=True):
                slider = tab.element(f"{plain(joint)} [°]")
                assert slider["min"] <= slider["value"] <= slider["max"]
                assert slider["value"] == pytest.approx(q, abs=0.06)
            tab.set("all within ± [°]", 30)
            within = target.model.kinematics.upper - target.model.kinematics.lower
            wait_for(lambda: (target.model.upper - target.model.lower <= np.minimum(within, np.radians(60.1))).all())
            assert (target.model.lower <= target.model.upper).all()
            assert len(target.model.answer(target.goal, target.model.home).postures)
            assert not tab.page.trouble
    finally:
        server.stop()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    "broken",
    [
        ("Target", "kinreach.view._target_panel.put"),
        ("Episodes", "kinreach.view._episodes_panel.EpisodesPanel.record"),
        ("Results", "kinreach.view._results_panel.by_user"),
    ],
)
def test_a_part_that_cannot_be_built_says_why(serve, monkeypatch, capfd, broken):
    """In its place, in red, and in one line on the terminal; nothing else of it is left, and the others work."""
    part, function = broken

    def fail(*arguments):
        raise ValueError("a <part>\x1b[2J\nis broken")

    monkeypatch.setattr(function, fail)
    with Tab(serve("arm3")) as tab:
        shown = {name: tab.page.show(name) for name in tab.page.names}
        tab.page.show(part)
        wait_for(lambda: "ValueError: a &lt;part&gt;" in tab.text)
        assert "\x1b" not in tab.text
        wait_for(lambda: tab.part == part)
        assert type(shown[part]) is Panel
        assert shown[part].program() == "# Nothing is shown.\n"
        assert all(type(panel) is not Panel for name, panel in shown.items() if name != part)
        assert len(shown) == 3
        assert shown[part] is tab.page.show(part)
    assert capfd.readouterr().err == "kinreach view: ValueError: a <part>\\x1b[2J is broken\n"


def test_a_page_that_cannot_be_built_says_why(serve, monkeypatch, capfd):
    monkeypatch.setattr("kinreach.view._page.Surroundings", None)
    with Tab(serve("arm3")) as tab:
        assert "TypeError: &#x27;NoneType&#x27; object is not callable" in tab.page.trouble
    assert capfd.readouterr().err == "kinreach view: TypeError: 'NoneType' object is not callable\n"


def test_an_episode_that_breaks_says_why(serve, monkeypatch, capfd):
    def fail(recording, **options):
        raise RuntimeError("no\nluck")

    monkeypatch.setattr(EpisodeRequest, "play", fail)
    with Tab(serve("arm3")) as tab:
        tab.page.show("Episodes")
        wait_for(lambda: "RuntimeError: no" in tab.text)
        wait_for(lambda: not tab.element("Play this episode")["disabled"])
    assert capfd.readouterr().err == "kinreach view: RuntimeError: no luck\n"


def test_parts_of_other_arms(serve, tmp_path):
    with Tab(serve("arm3")) as tab:
        assert tab.page.names == ("Target", "Episodes", "Results")
    assert SINGLE in setup_of("ur5e").environments
    (tmp_path / "bare.urdf").write_text(get_arm("ur5e").urdf)
    own = {BUTTON, REAL_ARM, MOVING, OBSTACLES, "kinreach/Push-v0", "kinreach/PickAndPlace-v0"}
    assert set(setup_of(str(tmp_path / "bare.urdf")).environments) == own  # it has no goals, these have another arm


@pytest.mark.slow
def test_an_episode_is_played_stepped_and_scrubbed(serve):
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.show("Episodes")
        wait_for(lambda: panel.episode)
        first, last = panel.episode, len(panel.episode.frames) - 1
        assert first.trial["reached"]
        wait_for(lambda: "Reached after 1 step" in tab.text)
        wait_for(lambda: panel.at == last and not panel.playing)
        wait_for(lambda: f"reward {first.steps[0].reward:.3g}<" in tab.text)
        (bars,) = re.findall('kr-bars">(.*?)</div></div>', tab.text)
        for name, value in first.steps[0].terms.items():
            assert re.search(f"{plain(name)}</span>.*?<span>{round(value, 2) + 0.0:g}</span>", bars)
        assert not tab.shows("Terms of the reward, step by step")
        tab.set("frame", last // 2)
        wait_for(lambda: panel.at == last // 2)
        wait_for(lambda: "kr-bars" not in tab.text)
        link = tab.nodes[f"/episodes/scene/{first.scene.links[-1]}"]
        wait_for(lambda: np.allclose(link["position"], first.frames[panel.at].poses[-1, :3]))
        tab.set("player", "step")
        wait_for(lambda: first.frames[panel.at].step == 1)
        panel.step()
        assert panel.at == last
        for stop, where in (("start", lambda: panel.at == 0), ("pause", lambda: panel.at > 3)):
            tab.set("player", "play")
            wait_for(lambda: 3 < panel.at < last)
            tab.set("player", stop)
            wait_for(lambda where=where: not panel.playing and where())
        assert "closed-form" in tab.page.shown.program()
        for file, said in (("README.md", "is not a policy"), ("os:system", "a module is named on the command line")):
            tab.set("or a file", file)
            tab.set("Play this episode", True)
            wait_for(lambda said=said: said in tab.text)
            assert panel.episode is first
            wait_for(lambda: not tab.element("Play this episode")["disabled"])
        tab.set("observation", "pixels")
        wait_for(lambda: "pixels-single" in tab.element("who acts")["options"])
        tab.set("environment", BUTTON)
        wait_for(lambda: tab.element("who acts")["value"] == "analytic")
        tab.set("or a file", "")
        tab.set("Play this episode", True)
        wait_for(lambda: panel.episode is not first)
        wait_for(lambda: panel.at > 2)
        panel.pause()
        steps = panel.episode.frames[panel.at].step
        wait_for(lambda: plotted(tab) == [steps + 1] * (2 + len(panel.episode.steps[0].terms)))
        wait_for(lambda: not tab.nodes["/world"]["visible"])
        tab.page.show("Target")
        wait_for(lambda: tab.nodes["/world"]["visible"])
        assert not panel.playing


def plotted(tab):
    """How many numbers each line of the plot has."""
    (plot,) = (element for element in tab.elements.values() if element["type"] == "GuiUplotMessage")
    return [len(column) for column in plot["data"]]


def test_an_episode_that_is_recorded_while_hidden_stands_still(serve, monkeypatch):
    hidden, play = threading.Event(), EpisodeRequest.play

    def later(recording, **options):
        assert hidden.wait(180)
        return play(recording, **options)

    monkeypatch.setattr(EpisodeRequest, "play", later)
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.show("Episodes")
        recorder = next(thread for thread in threading.enumerate() if thread.name.endswith("_record"))
        tab.page.show("Target")
        hidden.set()
        recorder.join(180)
        assert panel.episode is not None
        assert not panel.playing
        assert panel.at == 0
        tab.page.show("Episodes")
        panel.run()
        wait_for(lambda: panel.at > 0)


@pytest.mark.slow
def test_a_real_arm_beside_the_one_that_is_believed_in(serve):
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.show("Episodes")
        wait_for(lambda: panel.episode)
        first = panel.episode
        tab.set("environment", REAL_ARM)
        wait_for(lambda: tab.element("who acts")["value"] == "data-sheet")
        wait_for(lambda: tab.element("observation")["disabled"])
        tab.set("Play this episode", True)
        wait_for(lambda: panel.episode is not first)
        panel.go(40)
        wait_for(lambda: "blue: the arm as its user believes it to be" in tab.text)
        assert "/episodes/believed/forearm_link" in tab.nodes

        def apart():
            own, true = (tab.nodes[f"/episodes/{arm}/wrist_3_link"]["position"] for arm in ("believed", "scene"))
            return np.linalg.norm(np.subtract(own, true))

        wait_for(lambda: 0 < apart() < 0.02)


@pytest.mark.slow
def test_programs_of_all_parts_run(serve, comparison, capsys):
    """As they are copied: of a calibrated arm, in each part of the page."""
    said = {}
    with Tab(serve("ur5-thesis", CALIBRATION)) as tab:
        for name in tab.page.names:
            panel = tab.page.show(name)
            if name == "Results":
                panel.open(str(comparison))
            if name == "Episodes":
                wait_for(lambda panel=panel: panel.episode)
            capsys.readouterr()
            exec(compile(panel.program(), f"copied from {name}", "exec"), {})
            said[name] = capsys.readouterr().out
        real, played = tab.page.show("Real arm"), tab.page.show("Episodes")
        reached, steps, distance, _ = said["Episodes"].split()
        assert (reached, steps) == ("True", "1")
        assert float(distance) == pytest.approx(played.episode.trial["distance"])
        error = re.search(r"\[(.*)\]", said["Real arm"])[1].split()
        np.testing.assert_allclose(np.array(error, dtype=float), 1e3 * real.miss.vector, atol=1e-3)
    assert said["Target"].startswith("ok")
    assert said["Results"].splitlines()[1].startswith("closed-form True")
    assert len(said) == 5


def used(page):
    """Open all parts of a page; what must not outlive it, held weakly."""
    panels = [page.show(name) for name in page.names]
    episodes = panels[page.names.index("Episodes")]
    wait_for(lambda: episodes.episode)
    return [weakref.ref(thing) for thing in (page, *panels, episodes.episode, page.target.model)]


@pytest.mark.slow
def test_a_closed_tab_leaves_nothing(serve):
    """No threads of ours, and nothing of the page in memory."""
    server = serve("ur5-thesis")
    before = set(threading.enumerate())
    with Tab(server) as tab:
        seen = used(tab.page)
    del tab
    wait_for(lambda: not server.pages)
    ours = re.compile(r"Thread-|kinreach")
    wait_for(lambda: not any(ours.match(thread.name) for thread in set(threading.enumerate()) - before))
    wait_for(lambda: gc.collect() >= 0 and not any(thing() for thing in seen))
    assert len(seen) == 8


def test_a_goal_or_a_method_that_is_clicked_shows_where_it_ended(serve, comparison):
    with Tab(serve("arm3")) as tab:
        panel = tab.page.show("Results")
        panel.open(str(comparison / "nothing.json"))
        wait_for(lambda: "cannot read" in tab.text)
        panel.open(f" {comparison} ")
        wait_for(lambda: "closed-form reached 4 of 4 goals" in tab.text)
        wait_for(lambda: not tab.nodes["/world"]["visible"])
        goals = tab.nodes["/results/cell/goals"]
        np.testing.assert_allclose(goals["batched_positions"].reshape(-1, 3), panel.results.goals, atol=1e-6)
        tab.click("/results/cell/goals", instance=2)
        wait_for(lambda: panel.chosen == 2)
        ends = panel.results.ends[2]
        wait_for(lambda: f"{1000 * ends['thesis-ppo-single'].distance:.0f} mm" in tab.text)
        tips = tab.nodes["/results/cell/tips"]["batched_positions"]
        np.testing.assert_allclose(tips.reshape(-1, 3), [end.tip for end in ends.values()], atol=1e-6)
        assert tab.nodes["/results/cell/arm"]["visible"]
        near, link = brightness(tab), "/results/cell/arm/wrist_3_link"
        place = tab.nodes[link]["position"]
        tab.press("thesis-ppo-single")
        assert "kr-wrong" not in tab.text
        wait_for(lambda: "kr-wrong" in tab.text and "thesis-ppo-single reached 0 of 4 goals" in tab.text)
        wait_for(lambda: (brightness(tab) > near).all())
        assert 0.005 < np.linalg.norm(np.subtract(tab.nodes[link]["position"], place)) < 0.1
        panel.open(str(comparison / "report.html"))
        wait_for(lambda: "is not JSON" in tab.text)
        assert panel.results is not None
        tab.press("Target")
        wait_for(lambda: tab.nodes["/world"]["visible"])


def brightness(tab):
    """Of the goals of a comparison."""
    return tab.nodes["/results/cell/goals"]["batched_colors"].reshape(-1, 3).astype(int).sum(axis=1)


def ghosts(tab):
    """How many ghosts are seen, and their opacities."""
    wait_for(lambda: "/target/ghosts/0" in tab.nodes)
    piece = tab.nodes["/target/ghosts/0"]
    seen = piece["batched_opacities"] > 0
    return int(seen.sum()), set(piece["batched_opacities"][seen].astype(float).round(2).tolist())


def test_postures_are_clicked_pointed_at_and_copied(serve):
    with Tab(serve("ur5-thesis")) as tab:
        panel = tab.page.target
        panel.move(placement((0.5, 0.1, -0.05), (np.pi, 0, 0)))
        postures = panel.answer.postures
        assert panel.pointed == -1
        usable = [p for p in postures if p.state is State.USABLE]
        refused = next(p for p in postures if p.state is State.COLLIDES)
        wait_for(lambda: ghosts(tab)[0] == len(usable) - 1 > 1)
        nearest, other = (postures[panel.solid], next(p for p in usable if p is not postures[panel.solid]))
        for posture in (other, refused):  # the refused one's ghost is seen while the mouse is over it
            tab.press(posture.name, does="point")
            wait_for(lambda posture=posture: ghosts(tab) == (len(usable) - (posture is other), {0.07, 0.8}))
        tab.set("point at", "nothing")
        wait_for(lambda: ghosts(tab) == (len(usable) - 1, {0.3}))
        figure = setup_of("ur5-thesis", simple=True).figure
        for posture, shown, word in ((other, other, "kept"), (refused, refused, "kept"), (refused, nearest, "solid")):
            tab.press(posture.name)
            wait_for(lambda shown=shown, word=word: re.search(f"<b>{shown.name}</b>[^✗●]*>{word}<", tab.text))
            for link, pose in zip(figure.links, figure.poses(shown.q), strict=True):
                place = tab.nodes[f"/target/arm/{link}"].get("position", np.zeros(3))
                np.testing.assert_allclose(place, pose[:3], atol=1e-9)
        copied = [json.loads(text) for text in re.findall('data-copy="(.*?)"', tab.text)]
        for posture in postures:
            assert posture.q is None or any(np.allclose(posture.q, q, atol=0, rtol=1e-15) for q in copied)
        assert len(copied) == len([p for p in postures if p.q is not None]) > 4
        tab.press(other.name)
        panel.move(placement((0.95, 0.1, -0.05), (np.pi, 0, 0)))  # where the kept one does not reach
        wait_for(lambda: panel.answer.verdict in tab.text)
        assert "kept" not in tab.text
        panel.move(placement((0.5, 0.1, -0.05), (np.pi, 0, 0)))
        wait_for(lambda: re.search(f"<b>{other.name}</b>[^✗●]*>kept<", tab.text))
        tab.set("ghosts", "all")
        wait_for(lambda: ghosts(tab)[0] == len(copied) - 1)
        tab.set("ghosts", "none")
        wait_for(lambda: ghosts(tab)[0] == 0)


def test_an_input_that_changes_twice_gives_its_newest_value():
    """And nothing where the page itself changes it."""
    called, heard = [], []
    handle = SimpleNamespace(on_update=called.append, value=None)
    by_user(handle, heard.append)
    note, changed = called
    for client, value in ((1, "a"), (1, "b"), (None, "c"), (1, "d")):
        handle.value = value
        event = SimpleNamespace(client=client, target=handle)
        with contextlib.suppress(StopIteration):
            note(event).send(None)  # it waits for nothing
        changed(event)
    assert heard == ["a", "b", "d"]


def test_what_was_typed_is_taken_before_and_after_it_is_noted():
    """Of the two callbacks of a value, the one that answers may run first; taken once, it is not taken again."""
    callbacks = []
    handle = SimpleNamespace(value=0.0, on_update=callbacks.append)
    entry, taken = TypedInput(handle, lambda: None), 0

    def note():
        with contextlib.suppress(StopIteration):
            callbacks[0](SimpleNamespace(client=object(), target=handle)).send(None)

    for value in (0.3, 0.35, -0.2):
        handle.value = value
        assert entry.take() == value
        note()
        assert entry.take() is None
        entry.show(value + 1.0)
        assert handle.value == value + 1.0
        taken += 1
    handle.value = 5.0
    note()
    handle.value = value + 1.0  # typed back to what the page shows
    note()
    assert entry.take() is None
    assert taken == 3


def test_what_was_typed_and_not_yet_noted_is_not_written_over():
    """The page's own thread has the new value, and the thread that answers the one before shows that one."""
    callbacks = []
    handle = SimpleNamespace(value=0.0, on_update=callbacks.append)
    entry = TypedInput(handle, lambda: None)
    entry.show(0.5)
    assert handle.value == 0.5
    handle.value = 0.3  # by the page; its callbacks have not been called
    entry.show(0.0)
    assert handle.value == 0.3
    with contextlib.suppress(StopIteration):
        callbacks[0](SimpleNamespace(client=object(), target=handle)).send(None)
    entry.show(0.0)
    assert handle.value == 0.3
    handle.value = 0.4
    with contextlib.suppress(StopIteration):
        callbacks[0](SimpleNamespace(client=object(), target=handle)).send(None)
    assert entry.take() == 0.4
    assert entry.take() is None
    entry.show(0.1)
    assert handle.value == 0.1

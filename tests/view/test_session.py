"""Sessions of the page: after each step all that a browser has of it is as it is kept in tests/data/page."""

import contextlib
import re
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from kinreach._registration import BUTTON, REAL_ARM
from kinreach.robots import PUBLISHED_CALIBRATIONS
from kinreach.view._cli import setup_of

pytest.importorskip("viser")

from benchmarks.studies.tab import Tab, wait_for
from kinreach.view._episodes import Episode
from kinreach.view._server import Server
from tests import kept

CALIBRATION = str(PUBLISHED_CALIBRATIONS["ur5_a"])
#: For what is drawn to arrive [s].
PATIENCE = 180.0
CURVES = "/target/self_motion/"
#: Nothing changes any more, where states are kept [s].
STILL = 2.0
#: What viser gives to everything.
USUAL = {
    "scale": 1.0, "cast_shadow": True, "receive_shadow": True, "wireframe": False, "opacity": None, "visible": True,
    "flat_shading": False, "material": "standard", "disabled": False, "hint": None, "show_axes": False,
    "axes_length": 0.5, "axes_radius": 0.025, "origin_radius": 0.05, "origin_color": [236, 236, 0], "_marks": None,
    "_icon_html": None, "_hold_callback_freqs": [], "color": None,
}  # fmt: skip
OWN = ("uuid", "order", "container", "owner", "type", "label", "run_id", "render_uuid")


def turned(wxyz):
    """Where rotations bring a point; the quaternion has two signs."""
    w, v = np.asarray(wxyz, float).reshape(-1, 4)[:, :1], np.asarray(wxyz, float).reshape(-1, 4)[:, 1:]
    p = np.array([1.0, 2.0, 3.0])
    return (p + 2.0 * np.cross(v, np.cross(v, p) + w * p)).ravel()


def properties(thing, hidden):
    """Those that viser does not give to everything; times and folders are left out."""
    shown = {
        name: turned(value) if "wxyz" in name else value
        for name, value in thing.items()
        if name not in OWN and not (name in USUAL and np.array_equal(USUAL[name], value))
    }
    folders = "|".join(map(re.escape, (hidden, str(Path(CALIBRATION).parent))))
    times = re.compile(rf"\d+(\.\d+)?(e-\d+)?(?= ms\b)|{folders}")
    return {name: times.sub("#", kept.written(value)) for name, value in shown.items()}


def bounds(curves):
    """Lines by where they lie and their colours; how many points they have is up to the kinematics."""
    points, colours = (curves[name].reshape(-1, 3) for name in ("points", "colors"))
    edges = [f"{each:.2f}" for each in (*points.min(axis=0), *points.max(axis=0))]
    return {**curves, "points": edges, "colors": np.unique(colours, axis=0)}


def state(tab, hidden):
    """All that a browser has: texts and inputs by their folders, nodes of the scene, and settings."""
    found, inside = {}, {}
    for element in sorted(tab.elements.values(), key=lambda element: element.get("order", 0)):
        inside.setdefault(element["container"], []).append(element)

    def visit(container, path):
        for number, element in enumerate(inside.get(container, [])):
            name = f"{path}{number} {element.get('label') or element.get('type', 'modal')}"
            found[name] = properties(element, hidden)
            visit(element["uuid"], f"{name} > ")

    visit("root", "")
    nodes = {name: bounds(node) if name.startswith(CURVES) else node for name, node in tab.nodes.items()}
    for things in (nodes, tab.settings):
        found |= {name: properties(thing, hidden) for name, thing in sorted(things.items())}
    return found


class Session(contextlib.AbstractContextManager["Session"]):
    """Steps on a page; after each the browser has what is kept in tests/data/page."""

    def __init__(self, name, setup, hidden="/nowhere"):
        self._name, self._states, self._hidden = f"page/{name}.txt", {}, hidden
        self._kept = {} if kept.KEEP else kept.read(self._name)
        self._stack = contextlib.ExitStack()
        server = Server(setup, port=8600)
        self._stack.callback(server.stop)
        self.tab = self._stack.enter_context(Tab(server))

    def step(self, name):
        """Wait until what was done has arrived."""
        since, taken, others = time.monotonic(), -1, ["nothing yet"]
        while others and time.monotonic() - since < (STILL if kept.KEEP else PATIENCE):
            if self.tab.elements and self.tab.taken > taken:
                taken, now = self.tab.taken, state(self.tab, self._hidden)
                if kept.KEEP:
                    since = time.monotonic()
                else:
                    others = kept.differences(self._kept[name], now)
            time.sleep(0.01)
        self._states[name] = now
        assert kept.KEEP or not others, f"{name}: if it is meant, keep it with KINREACH_KEEP=1: {others}"

    def __exit__(self, kind, error, trace):
        self._stack.close()
        if kept.KEEP and error is None:
            kept.keep(self._name, self._states)


@pytest.mark.slow
def test_targets_of_a_calibrated_arm():
    setup = setup_of("ur5-thesis", calibration=CALIBRATION, simple=True)
    with Session("target", setup) as session:
        tab, target = session.tab, session.tab.page.target
        session.step("start")
        tab.set("x y z [m]", (0.5, 0.1, -0.05))
        wait_for(lambda: target.T[2, 3] == -0.05)
        tab.set("roll pitch yaw [°]", (180.0, 0.0, 0.0))
        session.step("a target that is typed")
        tab.set("ghosts", "all")
        session.step("all ghosts")
        tab.press("shoulder left, elbow up, wrist straight", does="point")
        session.step("pointed at")
        tab.set("point at", "nothing")
        session.step("no more")
        tab.press("shoulder left, elbow up, wrist straight")
        session.step("chosen")
        for solver in ("placo", "lm", "qp"):
            tab.set(solver, False)
        tab.set("Start them from this posture", True)
        session.step("another start")
        tab.set("Solve", True)
        session.step("solved")
        tab.set("draw the end of", "closed-form")
        session.step("the end is drawn")
        tab.set("all within ± [°]", 120)
        session.step("narrow limits")
        tab.drag("/target/goal", np.array([0.9, 0.3, 0.3]))
        session.step("out of reach")
        tab.set("Turn the tool down", True)
        session.step("tool down")
        tab.drag("/target/goal", np.array([0.5, 0.0, -0.25]))
        session.step("into the table")
        tab.press("shoulder left, elbow up, wrist straight")
        session.step("the nearest again, which collides")
        tab.press("Results")
        session.step("another part")
        tab.press("Target")
        session.step("the table again")
        tab.set("wrist 1 [°]", -60.0)
        session.step("a joint that is turned")
        tab.set("Back to the start", True)
        session.step("back")
        tab.press("Copy as Python")
        session.step("a program")
        tab.set("Close", True)
        tab.set("colours", "dark")
        session.step("dark")


@pytest.mark.slow
def test_the_other_parts_of_an_arm(comparison, monkeypatch):
    monkeypatch.setattr(Episode, "measure_goal", seen)
    with Session("parts", setup_of("ur5-thesis", simple=True), hidden=str(comparison)) as session:
        tab = session.tab
        tab.press("Real arm")
        session.step("a published calibration")
        tab.set("error drawn ×", 1)
        session.step("the error as it is")
        tab.set("map over the table", False)
        session.step("no map")
        tab.set("or a published", "ur5_c")
        session.step("another one")
        tab.set("map over the table", True)
        session.step("with its map")
        tab.drag("/real_arm/goal", np.array([0.4, 0.2, 0.1]))
        session.step("dragged")
        tab.drag("/real_arm/goal", np.array([2.5, 0.0, 0.0]))
        session.step("out of reach")
        tab.press("Copy as Python")
        session.step("a program")
        tab.set("Close", True)
        session.step("closed")
        tab.press("Results")
        session.step("no results")
        tab.set("file", str(comparison / "nothing.json"))
        tab.set("Open results", True)
        session.step("no file")
        tab.set("file", str(comparison))
        tab.set("Open results", True)
        session.step("results")
        tab.set("goal", 3)
        session.step("another goal")
        tab.press("thesis-ppo-single")
        session.step("another method")
        episodes = tab.page.show("Episodes")
        wait_for(lambda: episodes.episode and not episodes.playing)
        session.step("an episode to its end")
        tab.set("frame", 12)
        session.step("a frame of it")
        tab.set("player", "step")
        session.step("a step")
        tab.set("observation", "pixels")
        session.step("pictures")
        tab.set("environment", REAL_ARM)
        session.step("another environment")
        tab.set("Play this episode", True)
        wait_for(lambda: episodes.episode.frames[0].believed is not None)
        scrub(tab, episodes, 40)
        session.step("a real arm")


def test_an_arm_that_presses_a_button():
    """In full colours."""
    with Session("arm3", setup_of("arm3")) as session:
        tab = session.tab
        session.step("start")
        tab.drag("/target/goal", np.array([0.2, 0.3, 0.5]))
        session.step("dragged")
        tab.drag("/target/goal", np.array([2.0, 0.3, 0.5]))
        session.step("out of reach")
        episodes = tab.page.show("Episodes")
        wait_for(lambda: episodes.episode)
        tab.set("environment", BUTTON)
        wait_for(lambda: tab.element("who acts")["value"] == "analytic")
        tab.set("Play this episode", True)
        wait_for(lambda: len(episodes.episode.frames) > 40)
        scrub(tab, episodes, 30)
        session.step("an episode of many steps")
        tab.press("Screenshot")
        session.step("a picture is asked for")


def test_a_real_arm_without_a_calibration():
    with Session("ur16e", setup_of("ur16e", simple=True)) as session:
        session.tab.press("Real arm")
        session.step("no calibration")


@pytest.mark.slow
def test_the_self_motion_of_an_arm():
    with Session("panda", setup_of("panda", simple=True)) as session:
        tab = session.tab
        session.step("start")
        tab.set("along it [rad]", 0.8)
        session.step("along a curve")
        tab.set("asks for", "position and direction")
        session.step("another question")
        tab.set("asks for", "position only")
        session.step("a third")


def scrub(tab, episodes, frame):
    """Stop an episode that plays, and go to a frame."""
    wait_for(lambda: episodes.playing)
    tab.set("player", "pause")
    wait_for(lambda: not episodes.playing)
    with tab.page.lock:
        wait_for(lambda: tab.element("frame")["value"] == episodes.at)
    tab.set("frame", frame)


def seen(episode):
    """What the cameras saw; nothing is rendered."""
    image = SimpleNamespace(rgb=np.zeros((9, 16, 3), dtype=np.uint8))
    return SimpleNamespace(images=[image, image], fixes=[None, SimpleNamespace(circle=(8.0, 4.0, 2.0))])

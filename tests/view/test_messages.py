"""What a tab sends: whatever it is, it ends in a value or in a red sentence, and the tab goes on answering."""

from math import inf, nan

import numpy as np
import pytest

pytest.importorskip("viser")

from benchmarks.studies.page import Tab, wait_for
from kinreach.compare import compare
from kinreach.robots import PUBLISHED_CALIBRATIONS
from kinreach.view.cli import setup_of
from kinreach.view.server import Server

#: What no input takes.
BAD = (
    None, [], [[]], {}, {"value": 1.0}, ["a"] * 3, [None] * 3, [1.0] * 2, [1.0] * 4, [nan] * 3, [1e308] * 3, nan, inf,
    -inf, 1e308, -(2**63), 2**64 - 1, b"\xff", "\x1b[2J", "a\nb", "\0", "x" * 5000,
)  # fmt: skip


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    """A tab with all its parts open, of a calibrated arm and a comparison."""
    folder = tmp_path_factory.mktemp("comparison")
    compare("ur5", methods=["closed-form"], goals=2, out=folder)
    setup = setup_of("ur5", calibration=str(PUBLISHED_CALIBRATIONS["ur5_a"]), simple=True, results=str(folder))
    server = Server(setup, port=8500)
    with Tab(server) as opened:
        for name in opened.page.names:
            opened.page.show(name)
        wait_for(lambda: not opened.page._built["Episodes"]._button.disabled)
        yield opened
    server.stop()


def inputs(page):
    """All inputs of a page, by label."""
    return list(page._client.gui._gui_input_handle_from_uuid.values())


def answers(tab, capfd):
    """Whether a tab still answers, and has printed no traceback."""
    panel = tab.page.target
    tab.page.show("Target")
    panel.draw_s = 0.0
    tab.drag(panel._gizmo, (0.5, 0.1, 0.1))
    wait_for(lambda: panel.draw_s)
    assert "Traceback" not in capfd.readouterr().err
    assert panel.answer.verdict in panel._verdict.content
    return len(panel.answer.postures) > 0


def test_what_no_input_takes_is_a_red_sentence(tab, capfd):
    refused = 0
    for handle in inputs(tab.page):
        before = handle.value
        for bad in BAD:
            tab.page.report(None)
            tab.set(handle, bad)
            if handle.visible and not handle.disabled:
                wait_for(lambda: tab.page._trouble.content)
                assert "kinreach-verdict" in tab.page._trouble.content
                assert "\x1b" not in tab.page._trouble.content
                refused += 1
        assert handle.value == before
    assert refused > 700
    line = capfd.readouterr().err.splitlines()
    assert len(line) == refused
    assert all(text.isprintable() and text.startswith("kinreach view: ") for text in line)
    assert answers(tab, capfd)
    assert not tab.page._trouble.content  # what is accepted takes it away


def test_what_an_input_takes_is_answered(tab, capfd, monkeypatch):
    """The least and the most, all options, any text, every button: no error, whatever the order."""
    monkeypatch.setattr(tab.page, "picture", lambda height, width: np.zeros((height, width, 4), dtype=np.uint8))
    executor = tab.page._client.gui._thread_executor
    submit, work = executor.submit, []
    monkeypatch.setattr(executor, "submit", lambda *what: work.append(submit(*what)) or work[-1])
    rng, taken = np.random.default_rng(0), 0

    def odd(handle):
        if hasattr(handle, "options"):
            return handle.options
        if isinstance(handle.value, bool):
            return (True, False)
        if isinstance(handle.value, str):
            return ("", "no such file", "/", "a:b", "é" * 4000)
        return (handle.min, handle.max)

    cases = [(handle, value) for handle in inputs(tab.page) for value in odd(handle)]
    for index in rng.permutation(len(cases)):
        handle, value = cases[index]
        if handle.visible and not handle.disabled and value in odd(handle):
            tab.page._trouble.content = "sent"
            tab.set(handle, value)
            wait_for(lambda: tab.page._trouble.content != "sent")
            taken += 1
            wait_for(lambda: all(done.done() for done in work))
    assert taken > 90
    assert len(work) > 60
    wait_for(lambda: not tab.page._built["Episodes"]._button.disabled)
    assert "Error" not in capfd.readouterr().err
    assert answers(tab, capfd)


@pytest.mark.parametrize(
    "updates", [None, {}, [], "value", {"removed": True}, {"value": 1.0, "gui_api": None}, {"nothing": 1}]
)
def test_a_tab_changes_values_and_nothing_else(tab, capfd, updates):
    handle = tab.page.target._position
    before = vars(handle._impl).copy()
    tab.send({"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": updates})
    wait_for(lambda: "x y z [m]" in tab.page._trouble.content)
    assert vars(handle._impl) == before
    assert answers(tab, capfd)


@pytest.mark.parametrize(
    "what", [{"position": (nan, 0.0, 0.0)}, {"position": (1e300, 0.0, 0.0)}, {"wxyz": (inf, 0, 0, 0)}]
)
def test_a_drag_that_is_none_is_a_red_sentence(tab, capfd, what):
    gizmo = tab.page.target._gizmo
    before = gizmo.position
    message = {"type": "TransformControlsUpdateMessage", "name": gizmo.name, "owner": gizmo._impl.api._owner_id}
    tab.send({**message, "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 0.0), **what})
    wait_for(lambda: "what is dragged must be" in tab.page._trouble.content)
    np.testing.assert_array_equal(gizmo.position, before)
    assert answers(tab, capfd)


@pytest.mark.parametrize("instance", ["first", nan, [1], {}])
def test_a_click_that_is_none_is_a_red_sentence(tab, capfd, instance):
    tab.page.show("Results")
    tab.click(tab.page.shown._goals, instance=instance)
    wait_for(lambda: tab.page._trouble.content)
    assert answers(tab, capfd)

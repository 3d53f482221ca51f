"""What a tab sends: whatever it is, it ends in a value or in a red sentence, and the tab goes on answering."""

from contextlib import suppress
from html import escape
from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("viser")

from benchmarks.studies.tab import Tab, wait_for
from kinreach.errors import InputError
from kinreach.robots import PUBLISHED_CALIBRATIONS
from kinreach.view._cli import setup_of
from kinreach.view._messages import checked
from kinreach.view._server import Server

#: What no input takes.
BAD = (
    None, [], [[]], {}, {"value": 1.0}, ["a"] * 3, [None] * 3, [1.0] * 2, [1.0] * 4, [nan] * 3, [1e308] * 3, nan, inf,
    -inf, 1e308, -(2**63), 2**64 - 1, b"\xff", "\x1b[2J", "a\nb", "\0", "x" * 5000,
)  # fmt: skip


@pytest.fixture(scope="module")
def tab(comparison):
    """A tab with all its parts open, of a calibrated arm and a comparison."""
    setup = setup_of(
        "ur5-thesis", calibration=str(PUBLISHED_CALIBRATIONS["ur5_a"]), simple=True, results=str(comparison)
    )
    server = Server(setup, port=8500)
    with Tab(server) as opened:
        for name in opened.page.names:
            opened.page.show(name)
        wait_for(lambda: not labelled(opened, "Play this episode")["disabled"])
        yield opened
    server.stop()


@pytest.mark.parametrize("value", [[1.0] * 2, [1.0] * 4, None, "x", [nan] * 3])
def test_an_input_of_three_numbers_takes_three_numbers(value):
    handle = SimpleNamespace(label="x y z", value=(0.0, 0.0, 0.0))
    assert checked(handle, [1.0, 2, 3]) == (1.0, 2, 3)
    with pytest.raises(InputError, match="x y z must be"):
        checked(handle, value)


def labelled(tab, label):
    """The input of a label, hidden or not."""
    return next(element for element in tab.inputs if element["label"] == label)


def open_for_input(tab, element):
    return tab.elements[element["uuid"]]["visible"] and not element["disabled"]


def is_taken(tab, element, value):
    """Send a value until it is answered, or its input is closed."""

    def answered():
        return "sent" not in tab.page.trouble

    for _ in range(20):
        tab.set(element, value)
        # the server may have closed the input for a moment, before the tab knew it, and leaves what comes then
        with suppress(TimeoutError):
            wait_for(lambda: answered() or not open_for_input(tab, element), patience=10.0)
            return answered()
    raise TimeoutError("the page does not answer")


def still_answers(tab, capfd):
    """Check that a tab is answered, and told so, and that no traceback was printed."""
    panel = tab.page.target
    tab.set(labelled(tab, "show"), "Target")
    wait_for(lambda: tab.part == "Target")  # what was pressed before is done before
    panel.draw_s = 0.0
    tab.drag("/target/goal", (0.5, 0.1, 0.1))
    wait_for(lambda: panel.draw_s)
    assert "Traceback" not in capfd.readouterr().err
    wait_for(lambda: escape(panel.answer.verdict) in tab.text)
    assert len(panel.answer.postures) > 0


@pytest.mark.slow
def test_what_no_input_takes_is_a_red_sentence(tab, capfd):
    refused = 0
    for element in tab.inputs:
        before = tab.state_at_server(element)["value"]
        for bad in BAD:
            tab.page.report(None)
            tab.set(element, bad)
            if open_for_input(tab, element):
                wait_for(lambda: tab.page.trouble)
                assert "kinreach-verdict" in tab.page.trouble
                assert "\x1b" not in tab.page.trouble
                refused += 1
        assert tab.state_at_server(element)["value"] == before
        element["value"] = before
    assert refused > 700
    line = capfd.readouterr().err.splitlines()
    assert len(line) == refused
    assert all(text.isprintable() and text.startswith("kinreach view: ") for text in line)
    still_answers(tab, capfd)
    assert not tab.page.trouble  # what is accepted takes it away


@pytest.mark.slow
def test_what_an_input_takes_is_answered(tab, capfd, monkeypatch):
    """The least and the most, all options, any text, every button: no error, whatever the order."""
    monkeypatch.setattr(tab.page, "picture", lambda height, width: np.zeros((height, width, 4), dtype=np.uint8))
    rng, taken = np.random.default_rng(0), 0

    def odd(element):
        if "options" in element:
            return element["options"]
        if isinstance(element["value"], bool):
            return (True, False)
        if isinstance(element["value"], str):
            return ("", "no such file", "/", "a:b", "é" * 4000)
        return (element["min"], element["max"])

    inputs = [element for element in tab.inputs if element["label"] != "arm"]  # which begins the page anew
    cases = [(element, value) for element in inputs for value in odd(element)]
    for index in rng.permutation(len(cases)):
        element, value = cases[index]
        if open_for_input(tab, element) and value in odd(element):
            tab.page.report(InputError("sent"))
            taken += is_taken(tab, element, value)
    assert taken > 90
    wait_for(lambda: not labelled(tab, "Play this episode")["disabled"])
    assert "Error" not in capfd.readouterr().err
    still_answers(tab, capfd)


@pytest.mark.parametrize(
    "updates", [None, {}, [], "value", {"removed": True}, {"value": 1.0, "gui_api": None}, {"nothing": 1}]
)
@pytest.mark.slow
def test_a_tab_changes_values_and_nothing_else(tab, capfd, updates):
    tab.page.show("Target")
    element = tab.element("x y z [m]")
    before = tab.state_at_server(element)
    tab.send({"type": "GuiUpdateMessage", "uuid": element["uuid"], "updates": updates})
    wait_for(lambda: "x y z [m]" in tab.page.trouble)
    assert tab.state_at_server(element) == before
    still_answers(tab, capfd)


@pytest.mark.parametrize(
    "what", [{"position": (nan, 0.0, 0.0)}, {"position": (1e300, 0.0, 0.0)}, {"wxyz": (inf, 0, 0, 0)}]
)
def test_a_drag_that_is_none_is_a_red_sentence(tab, capfd, what):
    before = tab.page.target.T
    message = {"type": "TransformControlsUpdateMessage", "name": "/target/goal"}
    message |= {"wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 0.0), "owner": tab.nodes["/target/goal"]["owner"]}
    tab.send({**message, **what})
    wait_for(lambda: "what is dragged must be" in tab.page.trouble)
    np.testing.assert_array_equal(tab.page.target.T, before)
    still_answers(tab, capfd)


@pytest.mark.parametrize("instance", ["first", nan, [1], {}])
def test_a_click_that_is_none_is_a_red_sentence(tab, capfd, instance):
    tab.page.show("Results")
    tab.click("/results/cell/goals", instance=instance)
    wait_for(lambda: tab.page.trouble)
    still_answers(tab, capfd)


def test_of_the_parts_that_are_pressed_while_the_page_is_busy_the_last_is_shown(tab, monkeypatch):
    page, shown, rng = tab.page, [], np.random.default_rng(0)
    show = page.show
    monkeypatch.setattr(page, "show", lambda name: shown.append(name) or show(name))
    asked = []
    for _ in range(10):
        names = rng.permutation(page.names)[:3].tolist()
        with page.lock:
            for name in names:
                tab.set(labelled(tab, "show"), name)
                wait_for(lambda name=name: tab.state_at_server(labelled(tab, "show"))["value"] == name)
        asked.append(names[-1])
        wait_for(lambda: shown[-1:] == asked[-1:] and tab.part == asked[-1])
    assert len(shown) < 30
    assert set(shown) >= set(asked)

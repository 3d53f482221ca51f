"""A comparison that is opened, and the page in a real browser: the system's Chromium without a window."""

import pytest

from kinreach.compare import compare
from kinreach.view._cli import setup_of
from kinreach.view._server import Server

PATIENCE = 180_000  # [ms]: a machine that is busy draws a frame in seconds
#: A ninth of the pixels: without a graphics card a frame takes as long as it has pixels.
SMALLER = "?fixedDpr=0.33"


@pytest.fixture(scope="session")
def comparison(tmp_path_factory):
    """The folder of a comparison of the UR5 that one method fails."""
    out = tmp_path_factory.mktemp("comparison")
    compare("ur5", methods=["closed-form", "ppo-single", "thesis-ppo-single"], goals=4, out=out)
    return out


@pytest.fixture(scope="module")
def server():
    """Of a UR5, drawn simply."""
    pytest.importorskip("viser")
    serving = Server(setup_of("ur5-thesis", simple=True), port=8450)
    yield serving
    serving.stop()


@pytest.fixture(scope="module")
def open_tab(browser, server):
    """`open_tab()`: a new tab, as Playwright has it, as the server has it, and the addresses that it asked for.

    Options are its width and height in pixels.
    """
    contexts = []

    def opened(width=1000, height=640):
        before = set(server.pages)
        context = browser.new_context(viewport={"width": width, "height": height})
        contexts.append(context)
        tab, asked = context.new_page(), []
        tab.set_default_timeout(PATIENCE)
        tab.on("request", lambda request: asked.append(request.url))
        tab.goto(f"{server.address}/{SMALLER}")
        tab.wait_for_selector(".kinreach-postures")
        while not set(server.pages) - before:
            tab.wait_for_timeout(50)
        (number,) = set(server.pages) - before
        return tab, server.pages[number], asked

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture(scope="module")
def browser_page(open_tab):
    """One tab for the tests of a module."""
    return open_tab()

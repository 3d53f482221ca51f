"""What tests of every part share."""

from __future__ import annotations

import gc
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest.mock import Mock

# Two workers of pytest with two threads each would wait for one another on two cores: three times the processor time.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import pytest
from hypothesis import settings

from kinreach.errors import InstallationError
from kinreach.kinematics import URKinematics
from kinreach.sim import ArmSimulation, render
from tests.machine import SessionFolder, no_graphics

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: Rendering without a graphics card, and without the user namespaces that containers lack.
BROWSER_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
HEADED = 2  # lines of a table before its first row

# A shell's background job begins with Ctrl-C ignored, and so would every program that a test starts and interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples every time, on machines of any speed: what fails, a change has broken.
settings.register_profile("kinreach", derandomize=True, deadline=None)
settings.load_profile("kinreach")

ROOT = Path(__file__).resolve().parents[1]

PythonRunner = Callable[..., "subprocess.CompletedProcess[str]"]


FOLDER = pytest.StashKey[SessionFolder]()
#: The fixtures by which a test asks for graphics; to each other test the libraries are missing.
ASKING = {"needs_gl", "browser_path"}


def pytest_configure(config: pytest.Config) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):  # no test opens a window on somebody's screen
        os.environ.pop(name, None)
    if not hasattr(config, "workerinput"):  # workers of pytest-xdist inherit the folder
        kept = config.cache.mkdir("caches") if config.pluginmanager.hasplugin("cacheprovider") else None
        config.stash[FOLDER] = SessionFolder(kept, ROOT / "results")


def pytest_unconfigure(config: pytest.Config) -> None:
    if FOLDER in config.stash:
        config.stash[FOLDER].close()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of placo, an extra, by the names of their cases."""
    for item in items:
        if "placo" in item.name.partition("[")[2].lower():
            item.fixturenames.append("needs_placo")  # type: ignore[attr-defined]


def pytest_collection_finish() -> None:
    gc.freeze()  # what was imported stays: the collector need not look through it again


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """A test that draws and does not ask for it fails on every machine, not only on one without OpenGL."""
    if ASKING.intersection(item.fixturenames):
        return (yield)
    with no_graphics():
        return (yield)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """A run that leaves something behind in the home, the temporary folder or `results` fails."""
    if FOLDER in session.config.stash and (left := session.config.stash[FOLDER].left()):
        session.config.get_terminal_writer().line(f"\nThe tests left behind: {', '.join(left)}", red=True)
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def needs_gl() -> None:
    """Skip where nothing can be drawn, with the reason; fail instead where `KINREACH_REQUIRE_GL` is set, as in CI."""
    try:
        render(ArmSimulation("ur5-thesis"), width=8, height=8)
    except InstallationError as error:
        if os.environ.get("KINREACH_REQUIRE_GL"):
            pytest.fail(f"KINREACH_REQUIRE_GL is set, and nothing can be drawn: {error}")
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def needs_placo() -> None:
    """Skip where placo is not installed: it takes one Pinocchio only, and `make newest` another."""
    pytest.importorskip("placo")


@pytest.fixture(scope="session")
def browser_path() -> str:
    """A browser that starts; Ubuntu's `chromium-browser` may be a script that only says what to install.

    Skip where there is none, with the reason; fail instead where `KINREACH_REQUIRE_BROWSER` is set, as in CI.
    """
    for path in filter(None, map(shutil.which, BROWSERS)):
        if subprocess.run([path, "--version"], capture_output=True, timeout=300, check=False).returncode == 0:
            return path
    missing = f"none of {', '.join(BROWSERS)} is installed"
    if os.environ.get("KINREACH_REQUIRE_BROWSER"):
        pytest.fail(f"KINREACH_REQUIRE_BROWSER is set, and {missing}")
    pytest.skip(missing)


@pytest.fixture(scope="session")
def browser(browser_path):
    """The system's Chromium, driven by Playwright, which brings none."""
    if "KINREACH_REQUIRE_BROWSER" not in os.environ:
        pytest.importorskip("playwright")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=browser_path, args=BROWSER_ARGUMENTS)
        yield opened
        opened.close()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Why nothing can be drawn is said once, with the number of tests that it stopped."""
    for report in terminalreporter.stats.get("skipped", ()):
        if "cannot draw" in str(report.longrepr):
            report.longrepr = (__file__, 0, report.longrepr[2])


@pytest.fixture
def run_python(tmp_path: Path) -> PythonRunner:
    """`run_python(*arguments, before=folder, input=text)`: a fresh interpreter in an empty folder.

    kinreach comes from this repository; modules and distributions in `before` hide the installed ones.
    """

    def run(*arguments: str, before: Path | None = None, input: str | None = None) -> subprocess.CompletedProcess[str]:
        paths = [str(path) for path in (before, ROOT) if path is not None]
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            input=input,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )

    return run


@pytest.fixture
def texts() -> Callable[[Any], list[str]]:
    """Draws a figure for good, which finds what matplotlib would only warn of, and gives everything written in it."""

    def drawn(figure: Any) -> list[str]:
        figure.savefig(BytesIO(), format="png", dpi=50)
        return [text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text"))]

    return drawn


@pytest.fixture
def closings(monkeypatch):
    """`closings(gym, "make")`: the `close` of everything that this function makes from now on, as mocks that count."""

    def watch(owner: Any, name: str) -> list[Mock]:
        found, make = [], getattr(owner, name)

        def recorded(*arguments: Any, **options: Any) -> Any:
            made = make(*arguments, **options)
            found.append(Mock(wraps=made.close))
            monkeypatch.setattr(made, "close", found[-1])
            return made

        monkeypatch.setattr(owner, name, recorded)
        return found

    return watch


@pytest.fixture
def ur5():
    return ArmSimulation("ur5-thesis")


@pytest.fixture(scope="session")
def tool_down():
    """Posture of the UR5 with the tcp at a point of the world [m], pointing down."""
    kinematics = URKinematics("ur5-thesis", tip="tcp", base="world")

    def posture(position):
        result = kinematics.axis_goal(position, (0, 0, -1), np.array(kinematics.arm.home))
        assert result.success, result.reason
        return result.q

    return posture


@pytest.fixture(scope="session")
def goals():
    """Goals of the UR5 [m]: the corners of the area first, then drawn ones."""
    region = ArmSimulation("ur5-thesis").arm.workcell.goals
    corners = [(x, y, region.z[0]) for x in region.x for y in region.y]
    return np.array([*corners, *region.sample(np.random.default_rng(7), 60)])


@pytest.fixture(scope="session")
def doc_tables():
    """`doc_tables(docstring, heading)`: the tables of a docstring's section, each a list of rows of cells."""

    def tables(docstring, heading):
        section = docstring.split(f"## {heading}")[1].split("\n    ## ")[0]
        found = [block.splitlines() for block in re.findall(r"(?:^    \|.*\n?)+", section, re.MULTILINE)]
        return [
            [[cell.strip() for cell in row.strip().strip("|").split("|")] for row in rows[HEADED:]] for rows in found
        ]

    return tables

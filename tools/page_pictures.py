"""The pictures of docs/guides/viewer.md and the README: `python -m tools.page_pictures` (chromium, playwright).

A comparison's folder comes first: `python -m tools.page_pictures results/compare-ur5`. Without a graphics card a
picture takes some seconds.
"""

from __future__ import annotations

import argparse
import shutil
import threading
from collections.abc import Callable
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from kinreach._registration import MULTI
from kinreach.cli import Parser, finish
from kinreach.demo._film import Film
from kinreach.robots import PUBLISHED_CALIBRATIONS
from kinreach.robots._rotations import placement
from kinreach.view._cli import setup_of
from kinreach.view._server import Server
from kinreach.view._target_panel import TargetPanel

PROG = "python -m tools.page_pictures"
ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs/images"
CALIBRATION = PUBLISHED_CALIBRATIONS["ur5_a"]
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
WIDTH, HEIGHT = 1200, 750
#: Nothing takes longer [ms].
PATIENCE = 300_000
#: Frames per second of the film, and of each part of its way.
FPS, PART = 2, 3
QUALITY = 82
#: For the film the scene has fewer pixels than the window.
FASTER = "?fixedDpr=0.6"
#: Where the target goes in the film: over the table, into it, out of reach, and back.
WAY = [(0.5, 0.1, 0.05), (0.45, -0.25, -0.1), (0.5, 0.05, -0.25), (1.0, 0.3, 0.1), (0.5, 0.1, 0.05)]


class Camera:
    """A tab whose pictures are taken when all is drawn.

    Args:
        browser: Playwright's.
        server: Of the page.
        ask: Parameters of the address.
    """

    def __init__(self, browser: Any, server: Server, ask: str = "") -> None:
        self.tab = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}).new_page()
        self.tab.set_default_timeout(PATIENCE)
        self.tab.goto(f"{server.address}/{ask}")
        self.tab.wait_for_selector(".kinreach-verdict")
        self.page = next(iter(server.pages.values()))
        for close in self.tab.query_selector_all(".mantine-Notification-closeButton"):
            close.click()

    def take(self) -> Image.Image:
        """What is in the window."""
        thread = threading.Thread(target=self.page.picture, args=(40, 64))  # comes when all before it has been drawn
        thread.start()
        self.wait_for(lambda: not thread.is_alive())
        self.tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return Image.open(BytesIO(self.tab.screenshot())).convert("RGB")

    def wait_for(self, condition: Callable[[], object]) -> None:
        """Until something holds."""
        while not condition():
            self.tab.wait_for_timeout(50)


def film(camera: Camera, target: TargetPanel) -> None:
    """A target that is dragged, and what is said of it."""
    with Film(IMAGES / "view.gif", fps=FPS) as reel:
        for start, end in pairwise(WAY):
            for share in np.linspace(0, 1, PART)[start != WAY[0] :]:  # it is there already
                position = (1 - share) * np.array(start) + share * np.array(end)
                target.move(placement(position.tolist(), (np.pi, 0, 0)))
                picture = camera.take().resize((WIDTH * 3 // 4, HEIGHT * 3 // 4), Image.Resampling.LANCZOS)
                for _ in range(FPS if share == 1 else 1):
                    reel.add(np.array(picture))


def main(argv: list[str] | None = None) -> int:
    """Take them all."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", metavar="DIR", help="a comparison of the UR5")
    parser.add_argument("--only", metavar="NAME", help="target, real-arm, episodes, results or film")
    parser.add_argument("--simple", action="store_true", help="fewer triangles and no shadows")
    arguments = parser.parse_args(argv)
    server = Server(setup_of("ur5", simple=arguments.simple, environment=MULTI), port=8720)

    def wanted(name: str) -> bool:
        return arguments.only in (None, name)

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        camera = Camera(browser, server, FASTER if arguments.only == "film" else "")
        page = camera.page
        page.show("Target")
        page.target.move(placement((0.5, 0.1, -0.05), (np.pi, 0, 0)))
        if wanted("target"):
            camera.take().save(IMAGES / "view.jpg", quality=QUALITY)
        if wanted("real-arm"):
            page.show("Real arm").open(str(CALIBRATION))  # type: ignore[attr-defined]
            camera.take().save(IMAGES / "view_real_arm.jpg", quality=QUALITY)
        if wanted("episodes"):
            episodes: Any = page.show("Episodes")
            camera.wait_for(lambda: episodes.episode is not None and not episodes.playing)
            episodes.go(2 * len(episodes.episode.frames) // 3)
            camera.take().save(IMAGES / "view_episodes.jpg", quality=QUALITY)
        if wanted("results"):
            results: Any = page.show("Results")
            results.open(arguments.results)
            results.choose(7)
            camera.take().save(IMAGES / "view_results.jpg", quality=QUALITY)
        if wanted("film"):
            page.show("Target")
            film(camera, page.target)
        browser.close()
    server.stop()
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

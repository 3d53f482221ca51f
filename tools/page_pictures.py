"""The pictures of docs/guides/viewer.md and the README: `python -m tools.page_pictures` (chromium, playwright).

A comparison's folder comes first: `python -m tools.page_pictures results/compare-ur5`. Without a graphics card a
picture takes some seconds. `docs/images/view.webp` is that of `--only film --simple`.
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
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import sync_playwright

from kinreach._registration import MULTI
from kinreach._rotations import placement
from kinreach.cli import Parser, finish
from kinreach.view._server import Server
from kinreach.view._setup import setup_of
from kinreach.view._target_panel import TargetPanel

PROG = "python -m tools.page_pictures"
ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs/images"
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
WIDTH, HEIGHT = 1200, 750
#: Nothing takes longer [ms].
PATIENCE = 300_000
QUALITY = 85
#: Films: width and height in pixels, frames per second of the target's, and seconds that the last frame stays. The
#: target's is WebP, for its many ghosts make a GIF three times as large; the other is a GIF of so many colours.
FILM, FPS, LAST, COLOURS = (960, 600), 16, 2, 128
#: viser also draws once a second, which takes all of a processor that needs longer than that for a frame.
NO_HEARTBEAT = """const every = window.setInterval;
    window.setInterval = (call, ms, ...rest) => (ms === 1000 ? 0 : every(call, ms, ...rest));"""
#: For the film the scene has as many pixels as the film.
FASTER = "?fixedDpr=0.8"
#: Where the target goes in the film, and in how many frames: over the table, into it, out of reach, and back.
WAY = [(0.5, 0.1, 0.05, 1), (0.45, -0.2, 0.0, 14), (0.5, 0.0, -0.24, 12), (0.94, 0.16, 0.05, 14), (0.5, 0.1, 0.0, 12)]
#: Frames that the target or the pointer stands still.
STILL = 8
#: Which rows of the list the pointer goes to then, each in so many frames; the last one is clicked.
ROWS = [(1, 10), (2, 5), (3, 5)]
#: Goal and box of the film of a motion, its speed [%], and its frames per second; a GIF has hundredths of a second.
MOTION, SPEED, MOTION_FPS = ("-0.4, 0.3, 0.3, 3.14, 0, 0", "-0.2,-0.2,0.4,0.1,0.1,0.8"), 50, 100 / 6
#: Where it is scrubbed to on the chart, as parts of the time, each in so many frames.
SCRUBBED = [(1.0, 1), (0.4, 14), (0.5, 5)]
#: A mouse pointer, which pictures of a tab leave out.
POINTER = """() => {
    const arrow = '<svg width="22" height="30" viewBox="0 0 22 30"><path d="M1 1v22l5.5-5 3.5 9 4-1.6-3.6-8.7 7.6-.6z" '
        + 'fill="#111" stroke="#fff" stroke-width="1.6"/></svg>';
    document.body.insertAdjacentHTML("beforeend",
        `<div id="pointer" style="position:fixed;z-index:9999;pointer-events:none">${arrow}</div>`);
}"""
PLACE = "([x, y]) => Object.assign(document.getElementById('pointer').style, { left: `${x}px`, top: `${y}px` })"


class Camera:
    """A tab whose pictures are taken when all is drawn.

    Args:
        browser: Playwright's.
        server: Of the page.
        ask: Parameters of the address.
        size: Width and height of the window in pixels.
    """

    def __init__(self, browser: Any, server: Server, ask: str = "", size: tuple[int, int] = (WIDTH, HEIGHT)) -> None:
        context = browser.new_context(viewport={"width": size[0], "height": size[1]})
        context.add_init_script(NO_HEARTBEAT)
        self.tab = context.new_page()
        self.tab.set_default_timeout(PATIENCE)
        self.tab.goto(f"{server.address}/{ask}")
        self.tab.wait_for_selector(".kinreach-verdict")
        self.page = next(iter(server.pages.values()))
        for close in self.tab.query_selector_all(".mantine-Notification-closeButton"):
            close.click()

    def without_shadows(self) -> None:
        """Leave out shadows: without a graphics card they take three quarters of the time of a frame."""
        self.page.client.scene.configure_default_lights(cast_shadow=False)

    def take(self) -> Image.Image:
        """What is in the window."""
        thread = threading.Thread(target=self.page.picture, args=(40, 64))  # comes when all before it has been drawn
        thread.start()
        self.wait_for(lambda: not thread.is_alive())
        self.tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return Image.open(BytesIO(self.tab.screenshot())).convert("RGB")

    def wait_for(self, condition: Callable[[], object]) -> None:
        """Wait until a condition holds."""
        while not condition():
            self.tab.wait_for_timeout(50)


def self_motion(browser: Any, *, simple: bool) -> None:
    """A Panda that is moved along a curve of its self-motion."""
    server = Server(setup_of("panda", simple=simple), port=8740)
    camera = Camera(browser, server)
    camera.page.target.move(placement((0.5, 0.0, 0.3), (np.pi, 0, 0)))
    label = camera.tab.locator("label", has_text="along it [rad]")
    place = label.locator("xpath=ancestor::div[.//input][1]//input[@type='text']")
    place.fill("1.0")
    camera.wait_for(lambda: "kept" in camera.tab.inner_text(".kinreach-postures"))
    place.scroll_into_view_if_needed()
    camera.take().save(IMAGES / "view_self_motion.jpg", quality=QUALITY)
    server.stop()


def film(camera: Camera, target: TargetPanel) -> None:
    """A target that is dragged, what is said of it, and a posture that is chosen from the list."""
    tab, frames, at = camera.tab, [], np.zeros(2)
    camera.without_shadows()
    tab.evaluate(POINTER)

    def take(x: float, y: float, times: int = 1) -> None:
        tab.evaluate(PLACE, [x, y])
        frames.extend([camera.take().resize(FILM, Image.Resampling.LANCZOS)] * times)
        at[:] = x, y

    def go(x: float, y: float, count: int) -> None:
        start = at.copy()
        for share in np.linspace(0, 1, count + 1)[1:-1]:
            take(*(start + share * share * (3 - 2 * share) * ((x, y) - start)))

    for start, end in pairwise([WAY[0], *WAY]):
        for share in np.linspace(0, 1, end[3] + 1)[1:]:
            eased = share * share * (3 - 2 * share)
            position = (1 - eased) * np.array(start[:3]) + eased * np.array(end[:3])
            target.move(placement(position.tolist(), (np.pi, 0, 0)))
            take(*on_screen(camera.page.client.camera, position, WIDTH, HEIGHT), STILL if share == 1 else 1)
    rows = tab.locator(".kinreach-postures .kr-entry")
    for row, count in ROWS:
        box = rows.nth(row).bounding_box()
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        go(*middle, count)
        target.pointed = -1
        rows.nth(row).hover()
        camera.wait_for(lambda: target.pointed >= 0)
        take(*middle, STILL)
    rows.nth(row).click()
    camera.wait_for(lambda: "kept" in tab.inner_text(".kinreach-postures"))
    take(*middle, LAST * FPS)
    first, *rest = frames
    film: dict[str, Any] = {"append_images": rest, "duration": round(1000 / FPS), "loop": 0, "quality": 80, "method": 4}
    first.save(IMAGES / "view.webp", save_all=True, **film)


def motion(browser: Any, *, simple: bool) -> None:
    """A UR5e that is asked for a pose behind a pillar: planned, played, and scrubbed along the chart."""
    server = Server(setup_of("ur5e", simple=simple), port=8760)
    camera = Camera(browser, server, FASTER, FILM)
    panel: Any = camera.page.show("Move")
    tab, frames = camera.tab, []
    camera.without_shadows()
    tab.evaluate(POINTER)

    def take(seconds: float = 1 / MOTION_FPS) -> None:
        frames.extend([camera.take()] * max(1, round(MOTION_FPS * seconds)))

    def point(x: float, y: float) -> None:
        tab.evaluate(PLACE, [x, y])

    plan = tab.get_by_role("button", name="Plan").bounding_box()
    point(plan["x"] + plan["width"] / 2, plan["y"] - 20)
    take(0.6)
    panel.choose(goal=MOTION[0], speed=SPEED)
    take(0.8)
    panel.choose(goal=MOTION[0], boxes=MOTION[1])
    take(0.8)
    point(plan["x"] + plan["width"] / 2, plan["y"] + plan["height"] / 2)
    take(0.4)
    panel.plan()
    camera.wait_for(lambda: panel.shown is not None and panel.at == panel.last and not panel.playing)
    for time in np.arange(0.0, panel.shown.times[-1] + 1 / MOTION_FPS, 1 / MOTION_FPS):
        panel.go(round(time * panel.last / panel.shown.times[-1]))
        take()
    chart = tab.locator("[data-scrub]").bounding_box()
    for (start, _), (end, count) in pairwise(SCRUBBED):
        for share in np.linspace(start, end, count + 1)[1:]:
            panel.go(round(share * panel.last))
            point(chart["x"] + share * chart["width"], chart["y"] + chart["height"] / 2)
            take()
    take(LAST)
    save_gif(frames, IMAGES / "move_page.gif", fps=MOTION_FPS)
    server.stop()


def on_screen(camera: Any, point: NDArray[np.float64], width: int, height: int) -> tuple[float, float]:
    """Return where a point of the world is in a window of a size in pixels."""
    forward = camera.look_at - camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    x, y, z = np.array([right, np.cross(forward, right), forward]) @ (point - camera.position)
    focal = height / 2 / np.tan(camera.fov / 2)
    return float(width / 2 + focal * x / z), float(height / 2 + focal * y / z)


def save_gif(frames: list[Image.Image], path: Path, *, fps: float) -> None:
    """Write frames with the same colours in all, so that a frame has only what changes."""
    width, height = frames[0].size
    some = frames[:: max(1, len(frames) // 12)]
    sheet = Image.new("RGB", (width, height * len(some)))
    for index, frame in enumerate(some):
        sheet.paste(frame, (0, index * height))
    palette = sheet.quantize(COLOURS, Image.Quantize.FASTOCTREE)
    first, *rest = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    first.save(path, save_all=True, append_images=rest, duration=round(1000 / fps), loop=0, optimize=False)


def main(argv: list[str] | None = None) -> int:
    """Take the pictures and the film of the page."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", metavar="DIR", help="a comparison of the UR5")
    parser.add_argument(
        "--only", metavar="NAME", help="target, self-motion, real-arm, episodes, results, film or motion"
    )
    parser.add_argument("--simple", action="store_true", help="fewer triangles and no shadows")
    arguments = parser.parse_args(argv)

    def wanted(name: str) -> bool:
        return arguments.only in (None, name)

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        if wanted("motion"):
            motion(browser, simple=arguments.simple)
        if wanted("self-motion"):
            self_motion(browser, simple=arguments.simple)
        if arguments.only in ("motion", "self-motion"):
            browser.close()
            return 0
        server = Server(setup_of("ur5-thesis", simple=arguments.simple, environment=MULTI), port=8720)
        camera = Camera(browser, server, FASTER if arguments.only == "film" else "")
        page = camera.page
        page.show("Target")
        page.target.move(placement((0.5, 0.1, -0.05), (np.pi, 0, 0)))
        if wanted("target"):
            camera.take().save(IMAGES / "view.jpg", quality=QUALITY)
        if wanted("real-arm"):
            page.show("Real arm")
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
            results.choose_method(next(name for name in results.results.colours if name.startswith("ppo")))
            camera.take().save(IMAGES / "view_results.jpg", quality=QUALITY)
        if wanted("film"):
            page.show("Target")
            film(camera, page.target)
        browser.close()
    server.stop()
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

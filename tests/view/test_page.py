"""The page in a browser: what is dragged and typed is answered, and what is drawn is what the server says."""

import io
import re
import threading
import time

import numpy as np
import pytest
from PIL import Image

from kinreach._rotations import placement
from tools.page_pictures import on_screen

pytestmark = pytest.mark.slow

PATIENCE = 180.0  # [s]: a machine that is busy draws a frame in seconds


def wait_for(tab, condition, state=lambda: None):
    """Until something holds; the browser goes on meanwhile. `state` says what is there if it never does."""
    deadline = time.monotonic() + PATIENCE
    while not (held := condition()):
        assert time.monotonic() < deadline, state()
        tab.wait_for_timeout(50)
    return held


def picture(tab, page):
    """The scene as the browser draws it; asked for in a thread, because the browser needs this one."""
    taken = []
    thread = threading.Thread(target=lambda: taken.append(page.picture(300, 480)))
    thread.start()
    wait_for(tab, lambda: not thread.is_alive())
    return taken[0][..., :3].astype(int)


def is_red(pixels):
    r, g, b = np.moveaxis(pixels[..., :3].astype(int), -1, 0)
    return (r > 130) & (g < 0.6 * r) & (b < 0.6 * r) & (abs(g - b) < 40)


def red_pixels(tab, page):
    return int(is_red(picture(tab, page)).sum())


def drag_down(tab, page):
    """Drag the target by the arrow of the tool's own z axis, which points down; whether it went with the mouse.

    A browser that has not drawn a frame since the mouse moved does not know yet what is under it.
    """
    T, home = page.target.T, page.target.model.kinematics.fk(page.target.model.home)
    length = 0.8 * 0.25 * np.linalg.norm(home[:3, 3])
    size = tab.viewport_size["width"], tab.viewport_size["height"]
    x, y = on_screen(page.client.camera, T[:3, 3], *size)
    end_x, end_y = on_screen(page.client.camera, T[:3, 3] + length * T[:3, 2], *size)
    tab.mouse.move(end_x, end_y)
    tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    tab.mouse.down()
    for share in np.linspace(0, 1, 3):
        tab.mouse.move(end_x + share * (end_x - x), end_y + share * (end_y - y))
        tab.evaluate("() => new Promise(requestAnimationFrame)")
    tab.mouse.up()
    for _ in range(40):
        if np.linalg.norm(page.target.T[:3, 3] - T[:3, 3]) > 0.02:
            return True
        tab.wait_for_timeout(50)
    return False


def test_a_page_asks_nobody_but_its_server(browser_page):
    tab, page, asked = browser_page
    assert asked
    assert all(url.startswith(("http://127.0.0.1:", "blob:http://127.0.0.1:", "data:")) for url in asked)
    assert tab.inner_text(".kinreach-verdict") == page.target.answer.verdict


def test_dragging_moves_the_target_and_the_list_says_so(browser_page):
    tab, page, _ = browser_page
    before, listed = page.target.T.copy(), tab.inner_text(".kinreach-postures")
    wait_for(tab, lambda: drag_down(tab, page))
    wait_for(tab, lambda: tab.inner_text(".kinreach-postures") != listed)
    moved = page.target.T[:3, 3] - before[:3, 3]
    assert abs(moved @ before[:3, 2]) > 0.95 * np.linalg.norm(moved)
    assert page.target.draw_s > 0
    wait_for(tab, lambda: tab.inner_text(".kinreach-verdict") == page.target.answer.verdict)


def test_what_collides_is_red_and_named(browser_page):
    tab, page, _ = browser_page
    page.target.move(placement((0.5, 0.1, 0.0), (np.pi, 0, 0)))
    wait_for(tab, lambda: tab.inner_text(".kinreach-verdict") == page.target.answer.verdict)
    usable = red_pixels(tab, page)
    page.target.move(placement((0.5, 0.1, -0.25), (np.pi, 0, 0)))
    wait_for(tab, lambda: "finger left touches table" in tab.inner_text(".kinreach-verdict"))
    assert page.target.answer.usable == 0
    assert red_pixels(tab, page) > usable + 2000  # the table


def is_at_rest(tab, page, box):
    """Whether the box shows where the target is, and nothing of a move before is still on its way for a second."""
    T = page.target.T
    for _ in range(20):
        if page.target.T is not T or float(box.input_value()) != T[0, 3].round(3):
            return False
        tab.wait_for_timeout(50)
    return True


@pytest.mark.parametrize("typed", ["-0.2", "0.35", "-.25", "-0.05"])
def test_a_number_is_typed_sign_by_sign(browser_page, typed):
    tab, page, _ = browser_page
    box = tab.get_by_label("x y z [m]")
    # what the server still writes would undo that everything is selected
    wait_for(tab, lambda: is_at_rest(tab, page, box))
    box.click()
    box.press("Control+a")
    box.press_sequentially(typed, delay=100)
    wait_for(tab, lambda: page.target.T[0, 3] == float(typed), lambda: (page.target.T[0, 3], box.input_value()))
    assert float(box.input_value()) == float(typed)


def test_a_posture_is_pointed_at_clicked_and_copied(browser_page):
    tab, page, _ = browser_page
    panel = page.target
    panel.move(placement((0.5, 0.1, -0.05), (np.pi, 0, 0)))
    wait_for(tab, lambda: tab.inner_text(".kinreach-verdict") == panel.answer.verdict)
    index = next(i for i, p in enumerate(panel.answer.postures) if p.state.name == "USABLE" and i != panel.solid)
    posture = panel.answer.postures[index]
    row = tab.locator(".kinreach-postures .kr-entry", has_text=posture.name)
    row.hover()
    wait_for(tab, lambda: panel.pointed == index)
    tab.context.grant_permissions(["clipboard-read", "clipboard-write"])
    button = row.get_by_role("button", name="Copy the joint angles")
    color = button.evaluate(
        """button => new Promise(done => {
            const seen = () => done(getComputedStyle(button).color);
            new MutationObserver(seen).observe(button, { attributeFilter: ["class"] });
            button.click();
        })"""
    )
    red, green, _ = map(int, re.findall(r"\d+", color))
    assert green > red + 50  # for a moment
    wait_for(tab, lambda: tab.evaluate("navigator.clipboard.readText()") == str(posture.q.tolist()))
    assert panel.solid != index
    row.click()
    wait_for(tab, lambda: panel.solid == index)
    wait_for(tab, lambda: "kept" in row.inner_text())
    row.press("Enter")
    wait_for(tab, lambda: panel.solid != index)
    tab.mouse.move(200, 300)
    wait_for(tab, lambda: panel.pointed == -1)


def test_the_page_follows_the_colours_of_the_browser(browser_page):
    tab, *_ = browser_page
    for scheme in ("dark", "light"):
        tab.emulate_media(color_scheme=scheme)
        wait_for(tab, lambda scheme=scheme: tab.locator(f'html[data-mantine-color-scheme="{scheme}"]').count())
    assert tab.title() == "kinreach – ur5-thesis"


def test_nothing_is_seen_that_only_texts_press(browser_page):
    tab, *_ = browser_page
    for name in ("show", "do", "colours", "posture", "point at"):
        label = tab.get_by_text(name, exact=True)
        assert label.count() == 1
        assert not label.is_visible()


def test_on_a_phone_the_arm_and_the_verdict_are_in_view(open_tab):
    """The tip is above the sheet, the verdict in what is seen of it, and nothing is wider than the screen."""
    width, height = 390, 844
    tab, page, _ = open_tab(width=width, height=height)

    def boxes():
        parts = (".mantine-Paper-root:has(.kr-bar)", ".kinreach-verdict")
        sheet, verdict = (tab.locator(part).bounding_box() for part in parts)
        seen = sheet["y"] < verdict["y"] < verdict["y"] + verdict["height"] < height
        return (sheet, verdict) if seen else None

    sheet, _ = wait_for(tab, boxes)
    assert sheet["y"] > height / 2
    assert (sheet["x"], sheet["width"]) == (0, width)
    links = page.target.model.kinematics.fk(page.target.q)[:3, 3], np.zeros(3), np.array([0.0, 0.0, 0.6])
    for point in links:
        u, v = on_screen(page.client.camera, point, width, height)
        assert 0 < u < width
        assert 0 < v < sheet["y"]


def test_an_episode_is_played_and_its_screenshot_is_what_the_server_says(browser_page):
    """The ball is in the downloaded picture where the server has it, until the arm is there."""
    tab, page, _ = browser_page
    tab.get_by_role("tab", name="Episodes").click()
    panel = wait_for(tab, lambda: page.shown if page.shown is not page.target else None)
    episode = wait_for(tab, lambda: panel.episode)
    wait_for(tab, lambda: "1 of 1 steps" in tab.inner_text(".kinreach-moment"))
    assert tab.inner_text(".kinreach-verdict >> visible=true") == episode.verdict
    tab.get_by_role("button", name="start").click()
    wait_for(tab, lambda: tab.inner_text(".kinreach-moment").startswith("0.00 s, 0 of 1 steps"))
    wait_for(tab, lambda: red_pixels(tab, page) > 20)  # it is all drawn
    with tab.expect_download() as saved:
        tab.get_by_role("button", name="Screenshot").click()
    shot = np.array(Image.open(io.BytesIO(saved.value.path().read_bytes())))
    rows, columns = np.nonzero(is_red(shot))
    u, v = on_screen(page.client.camera, episode.goal, *shot.shape[1::-1])
    assert len(rows) > 100
    assert np.hypot(np.median(columns) - u, np.median(rows) - v) < 0.01 * shot.shape[1]

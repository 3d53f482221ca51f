"""The page in a browser: what is dragged and typed is answered, and what is drawn is what the server says."""

import os
import threading
import time

import numpy as np
import pytest

from kinreach.robots.rotations import pose

pytestmark = pytest.mark.skipif(
    "KINREACH_TEST_VIEW" not in os.environ, reason="draws in a browser; KINREACH_TEST_VIEW=1 runs it"
)

PATIENCE = 180.0  # [s]: a machine that is busy draws a frame in seconds


def wait_for(tab, condition):
    """Until something holds; the browser goes on meanwhile."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        tab.wait_for_timeout(50)


def picture(tab, page):
    """The scene as the browser draws it; asked for in a thread, because the browser needs this one."""
    taken = []
    thread = threading.Thread(target=lambda: taken.append(page.picture(300, 480)))
    thread.start()
    wait_for(tab, lambda: not thread.is_alive())
    return taken[0][..., :3].astype(int)


def red_pixels(tab, page):
    r, g, b = np.moveaxis(picture(tab, page), -1, 0)
    return int(((r > 130) & (g < 0.6 * r) & (b < 0.6 * r) & (abs(g - b) < 40)).sum())


def on_screen(page, point):
    """Where a point of the world is in the window, in pixels."""
    camera = page.target._client.camera
    forward = camera.look_at - camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    x, y, z = np.array([right, down, forward]) @ (np.asarray(point) - camera.position)
    focal = camera.image_height / 2 / np.tan(camera.fov / 2)
    return camera.image_width / 2 + focal * x / z, camera.image_height / 2 + focal * y / z


def test_a_page_asks_nobody_but_its_server(browser_page):
    tab, page, asked = browser_page
    assert asked
    assert all(url.startswith(("http://127.0.0.1:", "blob:http://127.0.0.1:", "data:")) for url in asked)
    assert tab.inner_text(".kinreach-verdict") == page.target.answer.verdict


def test_dragging_moves_the_target_and_the_list_says_so(browser_page):
    tab, page, _ = browser_page
    before, listed = page.target.T.copy(), tab.inner_text(".kinreach-postures")
    x, y = on_screen(page, before[:3, 3])
    # the handle of the tool's own z axis, which points down
    end_x, end_y = on_screen(page, before[:3, 3] + 0.8 * page.target._gizmo.scale * before[:3, 2])
    tab.mouse.move(end_x, end_y)
    tab.wait_for_timeout(300)
    tab.mouse.down()
    for share in np.linspace(0, 1, 5):
        tab.mouse.move(end_x + share * (end_x - x), end_y + share * (end_y - y))
        tab.wait_for_timeout(100)
    tab.mouse.up()
    wait_for(tab, lambda: np.linalg.norm(page.target.T[:3, 3] - before[:3, 3]) > 0.02)
    wait_for(tab, lambda: tab.inner_text(".kinreach-postures") != listed)
    moved = page.target.T[:3, 3] - before[:3, 3]
    assert abs(moved @ before[:3, 2]) > 0.95 * np.linalg.norm(moved)
    assert page.target.draw_s > 0
    wait_for(tab, lambda: tab.inner_text(".kinreach-verdict") == page.target.answer.verdict)


def test_what_collides_is_red_and_named(browser_page):
    tab, page, _ = browser_page
    page.target.move(pose((0.5, 0.1, 0.0), (np.pi, 0, 0)))
    wait_for(tab, lambda: tab.inner_text(".kinreach-verdict") == page.target.answer.verdict)
    usable = red_pixels(tab, page)
    page.target.move(pose((0.5, 0.1, -0.25), (np.pi, 0, 0)))
    wait_for(tab, lambda: "finger left touches table" in tab.inner_text(".kinreach-verdict"))
    assert page.target.answer.usable == 0
    assert red_pixels(tab, page) > usable + 2000  # the table

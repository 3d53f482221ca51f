"""The page of one browser tab."""

from __future__ import annotations

import threading
from typing import Any

from kinreach.robots import arm_names
from kinreach.robots.inside import FLANGE, JOINTS, ur_model
from kinreach.view import _html as html
from kinreach.view._draw import FloorGrid, Surroundings, overview
from kinreach.view._episodes_panel import EpisodesPanel
from kinreach.view._inputs import Latest, add_unseen
from kinreach.view._messages import error_message, watch
from kinreach.view._move_panel import MovePanel
from kinreach.view._panel import Panel
from kinreach.view._real_arm_panel import RealArmPanel
from kinreach.view._results_panel import ResultsPanel
from kinreach.view._setup import EPISODES, MOVE, REAL_ARM, RESULTS, TARGET, Setup, setup_of
from kinreach.view._target_panel import TargetPanel

LIGHT, DARK = "light", "dark"
#: Order of elements after all parts.
LAST = 1e6
#: Pixels of a screenshot.
WIDTH, HEIGHT = 1600, 1000


def panels(setup: Setup) -> dict[str, type[Panel]]:
    kinds: dict[str, type[Panel]] = {TARGET: TargetPanel}
    if setup.arm.joints == JOINTS and FLANGE in setup.arm.tips:
        kinds[MOVE] = MovePanel
    if ur_model((setup.nominal or setup.arm).name) is not None:
        kinds[REAL_ARM] = RealArmPanel
    kinds[EPISODES] = EpisodesPanel
    kinds[RESULTS] = ResultsPanel
    return kinds


class Page:
    """One tab; it shares nothing with others."""

    def __init__(self, client: Any, setup: Setup) -> None:
        self.client, self._first = client, setup
        self.lock = threading.RLock()
        self._pressed = Latest(self.lock)
        self.shown: Panel
        self._built: dict[str, Panel] = {}
        self._closed = False
        self._prepare(setup)
        watch(client, self.report)
        self._begin()

    def _prepare(self, setup: Setup) -> None:
        self._setup, self.names = setup, tuple(panels(setup))
        self._bar = self.client.gui.add_html("")
        self._trouble = self.client.gui.add_html("")

    def _begin(self) -> None:
        try:
            self._build()
        except Exception as error:  # the page shows it in place of the arm
            self.report(error)

    def take(self, arm: str) -> None:
        """Show another arm, by its name, from the beginning; the first one's name shows that as it was given."""
        with self.lock:
            if self._closed:
                return
            setup = self._first
            if arm != setup.arm.name:
                setup = setup_of(arm, simple=setup.simple)
            setup.figure  # noqa: B018  (an arm that cannot be drawn leaves the page as it is)
            for panel in self._built.values():
                panel.close()
            self._built.clear()
            self.client.scene.reset()
            self.client.gui.reset()
            self.client.gui.set_panel_label(setup.arm.title)
            self._prepare(setup)
            self._begin()

    def _build(self) -> None:
        client, arm = self.client, self._setup.arm
        overview(client, arm)
        client.scene.configure_default_lights(cast_shadow=not self._setup.simple)
        self._grid = FloorGrid(client.scene, arm.workcell.obstacles)
        self._surroundings = Surroundings(client.scene, arm.workcell.obstacles)
        add_unseen(client.gui, html.SHOW, self.names, lambda name: self._pressed(lambda: self.show(name)), order=LAST)
        add_unseen(client.gui, html.DO, (html.SCREENSHOT, html.PYTHON), self._do, order=LAST)
        add_unseen(client.gui, html.COLOURS, (LIGHT, DARK), self._colour, order=LAST)
        self._colour(LIGHT)
        self.show(self.names[0])
        self.show(self._setup.first)

    def report(self, error: Exception | None) -> None:
        """Show an error in red and print it on the terminal; None clears it."""
        if not self._closed and (error is not None or self._trouble.content):
            self._trouble.content = "" if error is None else error_message(error)

    @property
    def trouble(self) -> str:
        """Error of the last input as HTML; empty if there was none."""
        return str(self._trouble.content)

    @property
    def target(self) -> TargetPanel:
        return self._built[TARGET]  # type: ignore[return-value]

    def show(self, name: str) -> Panel:
        """Show one of `panels`, and hide the others; it is built when it is first shown.

        If it cannot be built, the error stands in its place.
        """
        with self.lock:
            for other, panel in self._built.items():
                if other != name:
                    panel.show(False)
            if name in self._built:
                self._built[name].show(True)
            else:
                self._built[name] = self._new(name)
            self.shown = panel = self._built[name]
            self._bar.content = html.bar(self.names, name)
            if self._closed:
                panel.close()
            return panel

    def _new(self, name: str) -> Panel:
        arguments = self.client, self._setup, self._surroundings, self.lock
        panel = panels(self._setup)[name](*arguments, title=name)
        if isinstance(panel, MovePanel):
            panel.target = lambda: self.target.T
        if isinstance(panel, TargetPanel):
            panel.arms, panel.take_arm = self._arms(), self.take
        try:
            panel.build()
        except Exception as error:
            panel.remove()
            panel = Panel(*arguments, title=name)
            with panel._folder:
                self.client.gui.add_html(error_message(error))
        return panel

    def _arms(self) -> tuple[str, ...]:
        """Names of the arms to choose from, the shown one first; none beside a motion, which is of its arm."""
        first, shown = self._first.arm.name, self._setup.arm.name
        return () if self._first.motion is not None else tuple(dict.fromkeys([shown, first, *arm_names()]))

    def close(self) -> None:
        with self.lock:
            self._closed = True
            for panel in self._built.values():
                panel.close()

    def _do(self, what: str) -> None:
        if what == html.SCREENSHOT:
            self.screenshot()
        else:
            self.show_program()

    def _colour(self, scheme: str) -> None:
        """Follow the colour scheme of the browser."""
        dark = scheme == DARK
        self.client.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False, dark_mode=dark)
        self._grid.colour(dark=dark)

    def show_program(self) -> None:
        gui = self.client.gui
        with gui.add_modal("What is on the screen, as a program") as modal:
            gui.add_html(html.code(self.shown.program()))
            close = gui.add_button("Close")
        close.on_click(lambda _: modal.close())

    def picture(self, height: int, width: int) -> Any:
        """Return the scene as the browser draws it, RGBA, shape (height, width, 4)."""
        return self.client.get_render(height, width, transport_format="png", timeout=60.0)

    def screenshot(self) -> None:
        import cv2

        picture = self.picture(HEIGHT, WIDTH)
        _, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGBA2BGRA))
        self.client.send_file_download("kinreach.png", data.tobytes(), save_immediately=True)

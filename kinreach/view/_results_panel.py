"""The part of the page that opens a comparison: goals to click, and the end of each method."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.errors import KinreachError
from kinreach.kinematics import ArmKinematics
from kinreach.robots import get_arm
from kinreach.view import _html as html
from kinreach.view._draw import RED, SolidArm, Surroundings, instance_colours, overview
from kinreach.view._figure import Figure
from kinreach.view._inputs import add_unseen, by_user
from kinreach.view._names import length
from kinreach.view._panel import Panel
from kinreach.view._real_arm import colours
from kinreach.view._results import Results, read_results
from kinreach.view._snippet import results_program

#: Radius of a goal [m], and the factor for the chosen one.
BALL, CHOSEN = 0.008, 2.2
#: Distances [m] of the darkest and the brightest colour of a goal; the scale between them is logarithmic.
LEAST, MOST = 1e-4, 1e-1
#: Colour of a goal that the method did not try.
UNKNOWN = (150, 150, 150)


class ResultsPanel(Panel):
    """The goals of a comparison, coloured by the distance of a method, and all ends on one of them."""

    def build(self) -> None:
        self.results: Results | None = None
        self.chosen = 0
        self.method = ""
        self._cell: Any = None
        self._solid: SolidArm | None = None
        with self._folder:
            self._build_gui()
        self._verdict.content = html.message("Name the results.json of a comparison, or its folder.")
        if self._setup.results is not None:
            self.open(self._setup.results)

    def show(self, visible: bool) -> None:
        with self._lock:
            super().show(visible)
            self._surroundings.visible = not visible or self.results is None
            if self._arm_differs:
                overview(self._client, get_arm(self.results.arm) if visible else self._setup.arm)  # type: ignore[union-attr]

    def open(self, file: str) -> None:
        """Open a comparison; if that fails, show the error and keep the last one."""
        try:
            results = read_results(file.strip())
        except KinreachError as error:
            self._verdict.content = html.message(str(error), bad=True)
            return
        with self._lock:
            self._take(results)

    def choose(self, index: int) -> None:
        with self._lock:
            if self.results is not None:
                self.chosen = int(np.clip(index, 0, len(self.results.goals) - 1))
                self._draw(self.results)

    def choose_method(self, name: str) -> None:
        with self._lock:
            if self.results is not None:
                self.method = name
                self._draw(self.results)

    def program(self) -> str:
        if self.results is None:
            return "# No results are open.\n"
        return results_program(self.results, self.chosen)

    @property
    def _arm_differs(self) -> bool:
        return self.results is not None and self.results.arm not in ("", self._setup.arm.name)

    def _build_gui(self) -> None:
        gui = self._client.gui
        self._verdict = gui.add_html("")
        self._index = gui.add_slider("goal", 0, 1, 1, 0, visible=False)
        self._table = gui.add_html("")
        self._scale = gui.add_html("")
        self._file = gui.add_text("file", self._setup.results or "", hint="results.json of kinreach compare")
        opened = gui.add_button("Open results")
        self._methods = add_unseen(gui, html.METHOD, ("",), self.choose_method)
        by_user(self._index, self.choose)
        opened.on_click(lambda _: self.open(self._file.value))

    def _take(self, results: Results) -> None:
        scene = self._client.scene
        if self._cell is not None:
            self._cell.remove()
        self._cell = scene.add_frame(f"{self._root}/cell", show_axes=False)
        self.results, self.chosen = results, 0
        self._solid = None
        if results.arm:
            arm = get_arm(results.arm)
            Surroundings(scene, arm.workcell.obstacles, root=f"{self._root}/cell/world")
            kinematics = ArmKinematics.of(arm, base="world")
            written = [end.q for ends in results.ends for end in ends.values() if end.q is not None]
            if written and all(len(q) == kinematics.n for q in written):
                self._solid = SolidArm(scene, f"{self._root}/cell/arm", Figure(kinematics, simple=self._setup.simple))
        self._goals = self._balls("goals", len(results.goals))
        self._goals.batched_positions = results.goals
        self._goals.on_click(self._clicked)
        self._tips = self._balls("tips", len(results.colours))
        self._ways = scene.add_line_segments(
            f"{self._root}/cell/ways", np.zeros((1, 2, 3)), RED, thickness=2.0, thickness_units="screen"
        )
        self._index.max = max(1, len(results.goals) - 1)
        self._index.visible = True
        self._methods.options = tuple(results.colours)
        self.method = next(iter(results.colours))
        self.show(True)
        self._draw(results)

    def _balls(self, name: str, count: int) -> Any:
        ball = trimesh.creation.icosphere(2, BALL)
        return self._client.scene.add_batched_meshes_simple(
            f"{self._root}/cell/{name}",
            np.array(ball.vertices),
            np.array(ball.faces),
            batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
            batched_positions=np.zeros((count, 3)),
            batched_scales=np.ones(count),
            batched_colors=np.zeros((count, 3)),
            lod="off",
            cast_shadow=False,
        )

    def _clicked(self, event: Any) -> None:
        if event.instance_index is not None:
            self.choose(event.instance_index)

    def _draw(self, results: Results) -> None:
        goal, ends = results.goals[self.chosen], results.ends[self.chosen]
        with self._client.atomic():
            scales = np.ones(len(results.goals))
            scales[self.chosen] = CHOSEN
            self._goals.batched_scales = scales
            self._draw_tips(results, goal)
            self._goals.batched_colors = instance_colours(_by_distance(results.distances(self.method)))
            posture = ends[self.method].q if self.method in ends else None
            if self._solid is not None:
                self._solid.visible = posture is not None
                if posture is not None:
                    self._solid.take(posture)
        self._index.value = self.chosen
        self._table.content = html.ends(results, self.chosen, self.method)
        reached = results.reached(self.method)
        bad, caution = not any(reached), not all(reached)
        self._verdict.content = html.message(_verdict(results, self.method), bad=bad, caution=caution)
        shades = colours(np.linspace(0.0, 1.0, 24), 1.0)
        title = f"Goals, by the distance from them that {self.method} ended at"
        self._scale.content = html.scale(shades, f"≤ {length(LEAST)}", f"≥ {length(MOST)}", title)

    def _draw_tips(self, results: Results, goal: Any) -> None:
        ends = results.ends[self.chosen]
        tips = np.tile(goal, (len(results.colours), 1))
        for row, name in enumerate(results.colours):
            end = ends.get(name)
            if end is not None and end.tip is not None:
                tips[row] = end.tip
        colours = np.array(list(results.colours.values()))
        self._tips.batched_positions = tips
        self._tips.batched_colors = instance_colours(colours)
        self._ways.points = np.stack([np.tile(goal, (len(tips), 1)), tips], axis=1)
        self._ways.colors = np.repeat(colours[:, None], 2, axis=1)


def _verdict(results: Results, method: str) -> str:
    reached = results.reached(method)
    distances = results.distances(method)
    known = distances[np.isfinite(distances)]
    median = f", {length(float(np.median(known)))} from them in the median" if len(known) else ""
    return (
        f"{results.title}: {method} reached {sum(reached)} of {len(reached)} goals{median}. Click a goal or a method."
    )


def _by_distance(distances: Floats) -> NDArray[np.uint8]:
    """Colours of goals, shape (count, 3), for distances [m]."""
    shares = np.log(np.clip(distances, LEAST, MOST) / LEAST) / np.log(MOST / LEAST)
    return np.where(np.isfinite(shares)[:, None], colours(shares, 1.0)[:, :3], UNKNOWN).astype(np.uint8)

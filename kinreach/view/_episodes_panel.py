"""The part of the page that plays episodes, with the reward's terms and the cameras' pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach.demo.inside import playable
from kinreach.envs.inside import BACKENDS, OBSERVATION_KINDS
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics
from kinreach.view import _html as html
from kinreach.view._draw import BLUE, BRANCH_COLOURS, RED, SolidArm, SolidScene, overview
from kinreach.view._episodes import Episode, EpisodeRequest, Stopped, circled
from kinreach.view._figure import Figure
from kinreach.view._inputs import by_user
from kinreach.view._names import plain
from kinreach.view._playing import PAUSE, PLAY, START, PlayedPanel
from kinreach.vision.inside import GoalMeasurement

STEP = "step"
#: Size of a contact [m].
DOT = 0.02
MAX_SEED = 2**31 - 1


class EpisodesPanel(PlayedPanel):
    """Plays episodes of any environment and policy."""

    def build(self) -> None:
        self.episode: Episode | None = None
        self._recording = EpisodeRequest(self._setup.environments[0], "", self._setup.arm)
        self._step = -1
        self._solid: SolidScene | None = None
        self._believed: SolidArm | None = None
        self._viewed_arm = self._setup.arm
        self._shown = True
        with self._folder:
            self._build_gui()
        self._points = self._client.scene.add_point_cloud(
            f"{self._root}/contacts", np.zeros((1, 3)), RED, point_size=DOT, point_shape="circle", visible=False
        )
        self._choose_environment(self._environment.value)
        self.record()

    def show(self, visible: bool) -> None:
        with self._lock:
            super().show(visible)
            self._furnish()

    def record(self) -> None:
        """Record the chosen episode in a thread of its own, then play it unless the part is hidden by then."""
        self.pause()
        self._button.disabled = True
        self._verdict.content = html.message("The episode is being played through ...")
        self._start(self._record)

    def step(self) -> None:
        """Go to the end of the next action."""
        self.pause()
        if self.episode is not None:
            self.go(self.episode.frame_after(self.episode.frames[self.at].step + 1))

    @property
    def last(self) -> int:
        """Index of the last frame; -1 without an episode."""
        return -1 if self.episode is None else len(self.episode.frames) - 1

    def program(self) -> str:
        return self._recording.program(self._setup.expression)

    def _build_gui(self) -> None:
        gui = self._client.gui
        self._verdict = gui.add_html("")
        self._build_player((PLAY, PAUSE, STEP, START), {STEP: self.step})
        self._slider = gui.add_slider("frame", 0, 1, 1, 0)
        self._now = gui.add_html("")
        self._bars = gui.add_html("")
        self._plot_place = gui.add_folder("Terms of the reward, step by step")
        self._plot: Any = None
        self._cameras = gui.add_folder("What the cameras see", expand_by_default=False)
        self._images: list[Any] = []
        with gui.add_folder("Episode"):
            self._environment = gui.add_dropdown("environment", self._setup.environments)
            self._policy = gui.add_dropdown(
                "who acts", [""], hint="Solvers, methods of the comparison, policies, chance"
            )
            self._file = gui.add_text("or a file", self._setup.policy or "", hint="policy.safetensors")
            self._observation = gui.add_dropdown(
                "observation", OBSERVATION_KINDS, initial_value="geometric",
                hint="What cameras measure, what perfect ones would, or pictures",
            )  # fmt: skip
            self._backend = gui.add_dropdown(
                "backend", BACKENDS, hint="With dynamics or without", initial_value="mujoco"
            )
            self._seed = gui.add_number("seed", 0, min=0, max=MAX_SEED, step=1)
            self._button = gui.add_button("Play this episode", icon="player-play")
        by_user(self._environment, self._choose_environment)
        by_user(self._observation, lambda value: self._choose_environment(self._environment.value))
        by_user(self._slider, self._scrubbed)
        self._button.on_click(lambda _: self.record())

    def _choose_environment(self, name: str) -> None:
        known = playable(name)
        observes = "observation" in known.choices
        arm = self._setup.nominal or self._setup.arm
        self._policy.options = known.players(arm, observation=self._observation.value if observes else "")
        self._observation.disabled, self._backend.disabled = not observes, "backend" not in known.choices

    def _record(self) -> None:
        """Record and play; a renderer belongs to the thread that made it."""
        try:
            asked = self._asked()
            episode = asked.play(simple=self._setup.simple, stop=self._gone)
        except Stopped:
            return
        with self._lock:
            if self._gone.is_set():
                return
            self._recording = asked
            self._take(episode)
            if self._shown:
                self.run()
        seen = episode.measure_goal()
        if not self._gone.is_set():
            self._show_cameras(episode, seen)

    def _asked(self) -> EpisodeRequest:
        environment, file = self._environment.value, self._file.value.strip()
        if ":" in file and file != self._setup.policy:
            raise InputError(f"a module is named on the command line, not here: kinreach view --policy {file}")
        inputs = {"observation": self._observation, "backend": self._backend}
        choices = playable(environment).choices
        options = {name: given.value for name, given in inputs.items() if name in choices}
        acts = file or self._policy.value
        return EpisodeRequest(environment, acts, self._setup.arm, seed=self._seed.value, options=options)

    def _take(self, episode: Episode) -> None:
        for old in (self._solid, self._believed):
            if old is not None:
                old.remove()
        scene = self._client.scene
        self._solid, self._believed = SolidScene(scene, f"{self._root}/scene", episode.scene), None
        if episode.frames[0].believed is not None:
            figure = Figure(ArmKinematics.of(episode.arm, base="world"), simple=True)
            self._believed = SolidArm(scene, f"{self._root}/believed", figure, colour=BLUE, opacity=0.4)
        self.pause()
        self.episode, self.at, self._step = episode, 0, -1
        self._slider.max = max(1, len(episode.frames) - 1)
        self._verdict.content = html.message(episode.verdict, bad=not episode.trial["reached"])
        self._new_plot(episode)
        self._cameras.visible = False
        self._button.disabled = False
        self._furnish()
        self._draw()

    def _furnish(self) -> None:
        """Show the work cell of the episode, or of the arm, from its own camera."""
        taken = self.episode is not None and self._shown
        self._surroundings.visible = not taken
        arm = self.episode.arm if taken else self._setup.arm  # type: ignore[union-attr]
        if arm is not self._viewed_arm:
            overview(self._client, arm)
            self._viewed_arm = arm

    def _new_plot(self, episode: Episode) -> None:
        if self._plot is not None:
            self._plot.remove()
            self._plot = None
        self._plot_place.visible = len(episode.steps) > 1
        if len(episode.steps) == 1:
            return
        names = list(episode.steps[0].terms)
        series = [{"label": "step"}, {"label": "reward", "stroke": "#868e96", "width": 2}]
        series += [
            {"label": plain(name), "stroke": html.css(colour), "width": 1.5, "points": {"show": True}}
            for name, colour in zip(names, BRANCH_COLOURS, strict=False)
        ]
        with self._plot_place:
            self._plot = self._client.gui.add_uplot(
                self._terms(episode, 0),
                tuple(series),
                scales={"x": {"time": False}},
                height=170,
                axes=({}, {"size": 64}),
                padding=(12, 12, 0, 0),
            )

    def _terms(self, episode: Episode, steps: int) -> tuple[Any, ...]:
        """Numbers, rewards and terms of the first steps; 0 before the first."""
        done, names = episode.steps[:steps], list(episode.steps[0].terms)
        rows = [np.zeros(1 + len(names)), *([s.reward, *(s.terms.get(n, 0.0) for n in names)] for s in done)]
        return (np.arange(1.0 + len(done)), *np.ascontiguousarray(np.array(rows).T))

    def _draw(self) -> None:
        episode = self.episode
        if episode is None:
            return
        frame = episode.frames[self.at]
        touching = {body for contact in frame.contacts for body in contact.bodies}
        with self._client.atomic():
            self._solid.place(frame.poses, red=touching)  # type: ignore[union-attr]
            if self._believed is not None and frame.believed is not None:
                self._believed.take(frame.believed)
            self._points.visible = bool(frame.contacts)
            if frame.contacts:
                self._points.points = np.array([contact.position for contact in frame.contacts])
                self._points.colors = np.tile(RED, (len(frame.contacts), 1))
        self._slider.value = self.at
        self._now.content = html.moment(episode, frame)
        if frame.step != self._step:
            self._step = frame.step
            terms = episode.steps[frame.step - 1].terms if frame.step else {}
            self._bars.content = html.bars(terms) if terms else ""
            if self._plot is not None:
                self._plot.data = self._terms(episode, frame.step)

    def _show_cameras(self, episode: Episode, seen: GoalMeasurement | None) -> None:
        with self._lock:
            if self.episode is not episode or seen is None:
                return
            for image in self._images:
                image.remove()
            with self._cameras:
                self._images = [
                    self._client.gui.add_image(circled(seen, index), label=camera.name, format="jpeg")
                    for index, camera in enumerate(episode.arm.goal_cameras)
                ]
            self._cameras.visible = True

    def _pause_after(self, index: int) -> float:
        return 0.0 if self.episode is None else self.episode.pause_after(index)

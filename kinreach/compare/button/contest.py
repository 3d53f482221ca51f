"""Methods that play whole episodes of the button task."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.table import Table

from kinreach.compare.button.episodes import run_episodes
from kinreach.compare.button.figures import draw_episodes, draw_pressed
from kinreach.compare.button.players import GIVEN, Player, analytic
from kinreach.compare.button.stage import ButtonStage
from kinreach.compare.button.summary import summarise
from kinreach.compare.button.tables import methods_table, notes
from kinreach.compare.contest import Contest, Run
from kinreach.compare.methods import new_method, short_name
from kinreach.compare.settings import Settings
from kinreach.compare.tasks import ButtonTask
from kinreach.compare.tasks.button import EpisodeSettings
from kinreach.compare.trials import EpisodeTrial
from kinreach.sim.picture import CAMERA
from kinreach.sim.rendering import FrameRenderer

_TERMS = {
    "observation": "the 19 numbers of the environment",
    "timing": "methods take turns in random order on every goal after an untimed episode; one process, one thread, one "
    "environment; the time of a step is that of choosing the action",
}


class ButtonContest(Contest[EpisodeTrial]):
    """A controller, policies and chance in the same episodes."""

    trial = EpisodeTrial
    methods: Mapping[str, Player]
    figures = {"pressed": draw_pressed, "episodes": draw_episodes}  # noqa: RUF012 (declared by `Contest`)

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self._task = _task(settings)
        self.methods = {short_name(name): new_method(self._task, name) for name in settings.methods}

    @contextmanager
    def trying(self) -> Iterator[Run[EpisodeTrial]]:
        """See `Contest.trying`."""
        task, settings = self._task, self.settings
        yield lambda done: run_episodes(task, self.methods, settings.goals, settings.seed, done=done)

    def summarise(self, name: str, trials: Sequence[EpisodeTrial]) -> dict[str, Any]:
        """See `Contest.summarise`."""
        return summarise(name, self.methods[name].kind, trials)

    def terms(self) -> dict[str, str]:
        """See `Contest.terms`."""
        kinds = {method.kind for method in self.methods.values()}
        given = {f"given to a {kind}": words for kind, words in GIVEN.items() if kind in kinds}
        return {**self._task.terms(), **given, **_TERMS}

    @staticmethod
    def tables(results: Mapping[str, Any], *, title: str) -> list[Table]:
        """See `Contest.tables`."""
        return [methods_table(results, title=title)]

    @staticmethod
    def notes(results: Mapping[str, Any]) -> list[str]:
        """See `Contest.notes`."""
        return notes(results)

    @staticmethod
    def stage(results: Mapping[str, Any]) -> ButtonStage:
        """See `Contest.stage`."""
        return ButtonStage(ButtonTask(EpisodeSettings(**results["settings"]["episode"])))

    @staticmethod
    def scene(settings: Settings) -> Any:
        """The arm where the analytic controller has brought it, and the button as that left it."""
        task = _task(settings)
        (trial,) = run_episodes(task, {"analytic": analytic(task)}, 1, settings.seed)
        stage = ButtonStage(task)
        stage.show(trial)
        with FrameRenderer(stage.model) as renderer:
            return renderer.rgb(stage.data, CAMERA)


def _task(settings: Settings) -> ButtonTask:
    return ButtonTask(settings.episode or EpisodeSettings())

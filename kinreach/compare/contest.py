"""What a comparison does in between: how the methods of a task are tried, and how what came out is reported."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from matplotlib.figure import Figure
from rich.table import Table

from kinreach.compare.settings import Settings
from kinreach.compare.trials import Trial

T = TypeVar("T", bound=Trial)
S = TypeVar("S", bound=Trial, contravariant=True)

#: Trials that are done already, to all others one after the other.
Run = Callable[[Collection[T]], Iterator[T]]
#: Trials and contents of `results.json` to a figure with a title.
Draw = Callable[[Sequence[Any], Mapping[str, Any]], Figure]


class Entrant(Protocol):
    """What a method is whatever the task."""

    @property
    def kind(self) -> str:
        """What sort of method it is."""
        ...

    @property
    def versions(self) -> Mapping[str, str]:
        """What its answers depend on besides code and packages, by name: digests of files."""
        ...


class Stage(Protocol[S]):
    """A scene in which the end of a trial can be drawn.

    Attributes:
        model, data: MuJoCo's.
    """

    model: Any
    data: Any

    def show(self, trial: S, /) -> list[str]:
        """Put everything where the trial left it, and say what there is to see."""
        ...


class Contest(ABC, Generic[T]):
    """A task and methods that do it.

    Args:
        settings: What to compare.

    Attributes:
        trial: Class of its trials.
        figures: How to draw what came out, by name of the file.
        settings: As given.
        methods: By the name that results call them, in their order.

    Raises:
        InstallationError: A method's packages are missing.
        InputError: A policy's file cannot be read, is none, or is for another task; or it does not come with the
            package.
    """

    trial: ClassVar[type[Trial]]
    figures: ClassVar[Mapping[str, Draw]]
    methods: Mapping[str, Entrant]

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    @abstractmethod
    def trying(self) -> AbstractContextManager[Run[T]]:
        """All that is needed to try the methods, until the context ends.

        Raises:
            InstallationError: Cameras are to look and nothing can be drawn.
            InputError: Pictures that cannot be that large.
        """

    @abstractmethod
    def summarise(self, name: str, trials: Sequence[T]) -> dict[str, Any]:
        """One entry of `methods` in `results.json`, from all trials of a method."""

    @abstractmethod
    def terms(self) -> dict[str, str]:
        """What every method is given alike, and what each kind is given, in words."""

    @staticmethod
    @abstractmethod
    def tables(results: Mapping[str, Any], *, title: str) -> list[Table]:
        """The results as tables for people, at most `TABLE_WIDTH` characters wide."""

    @staticmethod
    @abstractmethod
    def notes(results: Mapping[str, Any]) -> list[str]:
        """What the tables' numbers mean, line by line."""

    @staticmethod
    @abstractmethod
    def stage(results: Mapping[str, Any]) -> Stage[T]:
        """Where trials of these results can be drawn."""

    @staticmethod
    @abstractmethod
    def scene(settings: Settings) -> Any:
        """A picture of the task, uint8, shape (height, width, 3): its first goal, and the arm that has reached it.

        Raises:
            InstallationError: There is no library to draw with; the message names the packages.
        """

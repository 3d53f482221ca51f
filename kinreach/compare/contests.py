"""Which contest a task is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kinreach.compare.button.contest import ButtonContest
from kinreach.compare.contest import Contest
from kinreach.compare.reach_contest import ReachContest
from kinreach.compare.tasks import REACH_TASKS, ButtonTask

#: By task.
CONTESTS: Mapping[str, type[Contest[Any]]] = {
    **dict.fromkeys(REACH_TASKS, ReachContest),
    ButtonTask.name: ButtonContest,
}

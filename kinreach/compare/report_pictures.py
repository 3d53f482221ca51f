"""Pictures for the report: how an ordinary success and the worst end of each method look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from PIL import Image

from kinreach.compare.contests import CONTESTS
from kinreach.compare.tables import number
from kinreach.compare.trials import Trial
from kinreach.sim.picture import CAMERA
from kinreach.sim.rendering import FrameRenderer

#: Size of the pictures [pixels], and quality of their JPEG.
WIDTH, HEIGHT, QUALITY = 640, 360, 85


@dataclass(frozen=True)
class Rendering:
    """A picture of how a trial ended.

    Attributes:
        method: Whose trial.
        caption: What there is to see.
        jpeg: The picture.
    """

    method: str
    caption: str
    jpeg: bytes


def render_trials(trials: Sequence[Trial], results: Mapping[str, Any]) -> list[Rendering]:
    """Draw the trials that `chosen` picks, method by method.

    Args:
        trials: All of them.
        results: Contents of `results.json`.

    Raises:
        InstallationError: There is no library to draw with; the message names the packages.
    """
    stage = CONTESTS[results["settings"]["task"]].stage(results)
    found = []
    with FrameRenderer(stage.model, width=WIDTH, height=HEIGHT) as renderer:
        for method in results["methods"]:
            own = [trial for trial in trials if trial.method == method["name"]]
            for what, trial in chosen(own).items():
                seen = stage.show(trial)
                picture = BytesIO()
                Image.fromarray(renderer.rgb(stage.data, CAMERA)).save(picture, "JPEG", quality=QUALITY)
                found.append(Rendering(trial.method, _caption(what, trial, seen), picture.getvalue()))
    return found


def chosen(trials: Sequence[Trial]) -> dict[str, Trial]:
    """A method's ordinary success and its worst trial, by what to call them.

    The ordinary success has the median distance of all goals that were reached. The worst trial is the failure that
    left the tip farthest from the goal, impossible ones first; without a failure it is the success with the largest
    distance.

    Args:
        trials: Of one method, at least one.
    """
    reached = sorted((trial for trial in trials if trial.reached), key=lambda trial: trial.distance)
    failed = [trial for trial in trials if not trial.reached]
    found = {}
    if reached:
        found["success"] = reached[(len(reached) - 1) // 2]
    if failed:
        found["worst failure"] = max(failed, key=lambda trial: (trial.impossible, trial.distance))
    else:
        found["largest distance, reached all the same"] = reached[-1]
    return found


def _caption(what: str, trial: Trial, seen: Sequence[str]) -> str:
    said = [f"{what[0].upper()}{what[1:]}", f"goal {trial.goal}", f"{number(1e3 * trial.distance)} mm", *seen]
    return " · ".join(said)

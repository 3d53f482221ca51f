"""A picture of the scene beside the results, where the machine can draw one."""

from __future__ import annotations

from pathlib import Path

from matplotlib.image import imsave

from kinreach.compare.files import replacing
from kinreach.envs.rendering import render
from kinreach.envs.simulation import ArmSimulation
from kinreach.errors import InstallationError


def write_scene(arm: str, path: Path) -> str:
    """Draw an arm in its work cell, in the start posture, with a ball at a goal.

    Args:
        arm: Name of a registered arm.
        path: A PNG file.

    Returns:
        One line for the user: where the picture is, or why there is none. A comparison needs no OpenGL.

    Raises:
        OutputError: The file system refused.
    """
    try:
        picture = render(ArmSimulation(arm, visual=True))
    except InstallationError as error:
        return f"No picture of the scene: {' '.join(str(error).split())}"
    with replacing(path) as temporary:
        imsave(temporary, picture)
    return f"Scene: {path}"

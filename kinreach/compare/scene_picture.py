"""A picture of the scene beside the results, where the machine can draw one."""

from __future__ import annotations

from pathlib import Path

from matplotlib.image import imsave

from kinreach.compare.contests import CONTESTS
from kinreach.compare.settings import Settings
from kinreach.errors import DrawingError, InstallationError
from kinreach.files import replacing


def write_scene(settings: Settings, path: Path) -> str:
    """Draw the arm at the first goal of a comparison.

    Args:
        settings: Of the comparison.
        path: A PNG file.

    Returns:
        One line for the user: where the picture is, or why there is none. A comparison needs no OpenGL.

    Raises:
        OutputError: The file system refused.
    """
    try:
        picture = CONTESTS[settings.task].scene(settings)
    except (InstallationError, DrawingError) as error:
        return f"No picture of the scene: {' '.join(str(error).split())}"
    with replacing(path) as temporary:
        imsave(temporary, picture)
    return f"Scene: {path}"

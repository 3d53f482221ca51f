"""A picture of the scene beside the results, where the machine can draw one."""

from __future__ import annotations

from pathlib import Path

from matplotlib.image import imsave

from kinreach.compare.tasks import Task
from kinreach.envs.rendering import render
from kinreach.envs.simulation import ArmSimulation
from kinreach.errors import InstallationError
from kinreach.files import replacing
from kinreach.kinematics.solvers.closed_form import ClosedFormSolver


def write_scene(task: Task, path: Path, *, seed: int) -> str:
    """Draw the arm in its work cell, at the first goal of a seed in the posture of the closed form.

    Args:
        task: Whose arm, goals and question.
        path: A PNG file.
        seed: Of the goals.

    Returns:
        One line for the user: where the picture is, or why there is none. A comparison needs no OpenGL.

    Raises:
        OutputError: The file system refused.
    """
    goal = task.goals(1, seed)[0]
    posture = ClosedFormSolver(task.new_kinematics()).solve(task.ik_goal(goal), task.home, accept=task.accept)
    simulation = ArmSimulation(task.arm_name, visual=True)
    simulation.reset(posture.q)
    simulation.place_ball(goal)
    try:
        picture = render(simulation)
    except InstallationError as error:
        return f"No picture of the scene: {' '.join(str(error).split())}"
    with replacing(path) as temporary:
        imsave(temporary, picture)
    return f"Scene: {path}"

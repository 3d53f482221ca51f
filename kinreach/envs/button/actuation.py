"""What turns an action into torque: the two sets of parameters, the report's and one that can be learned."""

from __future__ import annotations

from dataclasses import dataclass

from kinreach.robots import get_arm

_ARM = get_arm("arm3")


@dataclass(frozen=True)
class Actuation:
    """Motors, friction and time of an arm under torque.

    Attributes:
        name: What it is asked for by.
        gears: Torque of each motor per unit of control [N m].
        damping: Viscous friction of each joint [N m s/rad].
        armature: Rotor inertia seen at each joint [kg m^2].
        timestep: Step of the simulation [s].
        frame_skip: Steps of the simulation in one step of the environment.
        effort_limits: Whether the URDF's effort bounds the torque.
    """

    name: str
    gears: tuple[float, ...]
    damping: tuple[float, ...]
    armature: float
    timestep: float
    frame_skip: int
    effort_limits: bool

    @property
    def period(self) -> float:
        """Time of one step of the environment [s]."""
        return self.timestep * self.frame_skip


#: As the course project has it: no friction, no rotor inertia, MuJoCo's default timestep. Full control of the base
#: is 8250 N m where the arm's inertia is a few kg m^2.
REPORT = Actuation(
    name="report",
    gears=(825.0, 10.0, 3.0),
    damping=(0.0, 0.0, 0.0),
    armature=0.0,
    timestep=0.002,
    frame_skip=2,
    effort_limits=False,
)
#: Full control is the effort of the URDF, 40, 80 and 25 N m: 1.7 times and more what gravity asks for.
TUNED = Actuation(
    name="tuned",
    gears=(4.0, 8.0, 2.5),
    damping=_ARM.joint_damping,
    armature=_ARM.armature,
    timestep=0.004,
    frame_skip=10,
    effort_limits=True,
)
ACTUATIONS = {actuation.name: actuation for actuation in (TUNED, REPORT)}

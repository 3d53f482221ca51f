"""Prints IK, collisions, a simulated move and a comparison of the Panda, from its URDF.

    python examples/13_own_arm.py

The Panda has seven joints. Here it gets a table and goals. Needs no extra.
"""

import numpy as np
from example_robot_data.robots_loader import getModelPath

from kinreach.compare import compare
from kinreach.kinematics import (
    ArmKinematics,
    AxisGoal,
    CollisionChecker,
    LevenbergMarquardtSolver,
    PlacoSolver,
    QPSolver,
)
from kinreach.robots import ArmDescription, Box, BoxRegion, Workcell
from kinreach.sim import ArmSimulation

file = "panda_description/urdf/panda.urdf"
table = Box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.08))
panda = ArmDescription.from_urdf(
    f"{getModelPath(file)}/{file}",
    name="panda",
    tip="panda_hand_tcp",
    home=(0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785),
    workcell=Workcell(
        obstacles=(table,),
        goals=BoxRegion(x=(0.35, 0.6), y=(-0.25, 0.25), z=(0.15, 0.35)),
    ),
)

kin = ArmKinematics(panda, base="world")
home = np.array(panda.home)
print(
    "tip at home:", kin.fk(home)[:3, 3].round(3), "Jacobian:", kin.jacobian(home).shape
)

checker = CollisionChecker(panda)
goal = AxisGoal([0.5, 0.2, 0.25], [0, 0, -1])  # the hand straight down
for solver in (LevenbergMarquardtSolver(kin), QPSolver(kin), PlacoSolver(kin)):
    result = solver.solve(goal, home, accept=checker.free)
    print(
        f"{solver.name}: {result.status.value}, "
        f"{1000 * result.position_error:.4f} mm off, {result.iterations} steps"
    )

down = kin.fk(result.q)[:3, 3] - [0, 0, 0.2]  # 20 cm deeper is inside the table
deep = LevenbergMarquardtSolver(kin).solve(AxisGoal(down, [0, 0, -1]), result.q)
print(
    "20 cm deeper touches:",
    sorted({name for pair in checker.contacts(deep.q) for name in pair}),
)

simulation = ArmSimulation(panda)
move = simulation.move(result.q)
miss = np.linalg.norm(simulation.tip_position - goal.position)
print(
    f"simulated move: {move.status.value}, {move.duration:.2f} s, "
    f"tip {1000 * miss:.2f} mm from the goal"
)

(row,) = compare("ur5", arm=panda, methods=["lm"], goals=20)["methods"]
print(
    f"compare, lm: {100 * row['reached']:.0f} % reached, "
    f"{row['distance_mm']['median']:.3f} mm in the median"
)

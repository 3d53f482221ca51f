"""Analytic and numeric kinematics: FK, Jacobians, limits, closed-form IK, solvers, collisions.

- `ArmKinematics.of`, `ArmKinematics.from_file`: the kinematics of an arm, of the class that lists all postures of
  a pose where there is one: `URKinematics` (`CalibratedURKinematics` of a calibrated one), `Arm3Kinematics`,
  `SixAxisKinematics`, all of them `ClosedFormKinematics`; and `SevenAxisKinematics`, whose `SelfMotions` are curves.
- `PoseGoal`, `AxisGoal`, `PositionGoal`, or your own `Goal`: goals of a solver; `IKResult` with a `Status`: its result.
- `ClosedFormSolver`, `PlacoSolver`, `LevenbergMarquardtSolver`, `QPSolver`: solvers with one interface,
  `Solver`, which stop within a `Tolerance`.
- `pose`, `pose_vector`: poses as six numbers, as a UR's pendant writes them.
- `CollisionChecker`: which links touch each other, or an obstacle; `Cause`: why a posture is impossible.
- `plan_path`, `joint_line`, `tool_line`: paths as waypoints, around obstacles, straight in joint space, and straight
  for the tool.
- `time_waypoints`, `time_path`: motions along them within the `MotionLimits` of the arm: a `Trajectory`.
- `check`: measurements of an arm before you rely on it.

Closed forms, solvers and `check` are imported when they are first used. The modules are internal.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

"""The thesis's single-step path planning."""

from __future__ import annotations

from kinreach.envs.reach.env import UR5ReachEnv
from kinreach.envs.reach.task import SINGLE_STEP


class UR5SingleStepEnv(UR5ReachEnv):
    """Single-step reaching with a UR5: one action is one posture.

    ## Description
    A UR5 with a gripper stands before a table on which a red ball lies. One action sets all six joints; the arm moves
    there, the episode is over. The task is that of the thesis's single-step path planning (sections 3.4.2 to 3.4.5).

    ## Action Space
    `Box(-1, 1, (6,), float32)`: joint targets in units of pi rad. What is outside [-1, 1] is clipped.

    | Num | Action | Min | Max | Unit of the target |
    |-----|--------|-----|-----|--------------------|
    | 0 | target of shoulder_pan_joint | -1 | 1 | pi rad |
    | 1 | target of shoulder_lift_joint | -1 | 1 | pi rad |
    | 2 | target of elbow_joint | -1 | 1 | pi rad |
    | 3 | target of wrist_1_joint | -1 | 1 | pi rad |
    | 4 | target of wrist_2_joint | -1 | 1 | pi rad |
    | 5 | target of wrist_3_joint | -1 | 1 | pi rad |

    With `backend="mujoco"` all joints but shoulder_lift move first, then shoulder_lift, by dynamics: the gripper comes
    from above. With `backend="kinematic"` the posture is taken at once; limits and collisions of it are still judged.

    ## Observation Space
    `Box(13,), float64`. The goal is measured once per episode, in the start pose, in the optical frames of the cameras
    (x right, y down, z forward). `observation="geometric"` gives its true position; `"camera"` what is found in the
    rendered images (0, 0, 0 where no ball is found: no goal for that episode, and `info["ball_found"]` says so);
    `"pixels"` gives a `Dict` with the images instead (`front_rgb`, `front_depth`, `wrist_rgb`, `wrist_depth`, `joints`,
    `gripper`).

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | goal in the front camera, x | -2 | 2 | m |
    | 1 | goal in the front camera, y | -2 | 2 | m |
    | 2 | goal in the front camera, z | -2 | 2 | m |
    | 3 | goal in the wrist camera, x | -2 | 2 | m |
    | 4 | goal in the wrist camera, y | -2 | 2 | m |
    | 5 | goal in the wrist camera, z | -2 | 2 | m |
    | 6 | angle of shoulder_pan_joint | -3.161593 | 3.161593 | rad |
    | 7 | angle of shoulder_lift_joint | -3.161593 | 3.161593 | rad |
    | 8 | angle of elbow_joint | -3.161593 | 3.161593 | rad |
    | 9 | angle of wrist_1_joint | -3.161593 | 3.161593 | rad |
    | 10 | angle of wrist_2_joint | -3.161593 | 3.161593 | rad |
    | 11 | angle of wrist_3_joint | -3.161593 | 3.161593 | rad |
    | 12 | opening of the gripper | 0 | 2 | m |

    ## Rewards
    With d the distance from the tcp to the ball's centre and r_e the posture error (natural arm plus gripper angle,
    `kinreach.kinematics.reward_geometry`): r_d - r_e with r_d = 1 - d/2 for d >= 2 m, else 0.5 - 0.5 log2(d);
    10 - r_e for d < 0.01 m; 20 for d < 0.01 m and r_e < 0.15 (reached); -100 where the action is impossible: a target
    outside the limits, or one that the arm does not attain because something is in the way (`info["impossible_reason"]`
    says what). `info["reward_terms"]` has the terms `natural_arm`, `gripper_angle`, `distance` and `special`; their sum
    is the reward.

    ## Starting State
    The arm stands in [-pi/2, -pi/2, pi/2, -pi/2, -pi/2, 0] rad. The ball lies on the table, uniformly in
    0.30 <= x <= 0.65 m and -0.30 <= y <= 0.30 m of the world frame; `reset(options={"goal": (x, y, z)})` puts it
    elsewhere.

    ## Episode End
    Every episode terminates after its only action.

    ## Arguments

    | Parameter | Default | Description |
    |-----------|---------|-------------|
    | `observation` | `"geometric"` | `"camera"`, `"geometric"` or `"pixels"` |
    | `backend` | `"mujoco"` | `"mujoco"` (dynamics) or `"kinematic"` |
    | `render_mode` | `None` | `"human"`, `"rgb_array"`, `"rgb_array_list"` (frames of the motion) or `"depth_array"` |
    | `pipeline` | `"hybrid"` | how the ball is found: `"hybrid"` or the thesis's own, `"thesis"` |
    | `width` | `640` | width of the cameras' images [px] |
    | `height` | `360` | height of the cameras' images [px] |
    | `rgb_noise` | `0.0` | standard deviation of the colours' noise [levels of 255] |
    | `depth_noise` | `0.0` | standard deviation of the depth's noise [m] |
    | `end_on_reached` | `True` | means nothing here: there is one step |

    ## Version History
    * v0: initial version
    """

    variant = SINGLE_STEP

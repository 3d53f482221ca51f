"""The thesis's multi-step path planning."""

from __future__ import annotations

from kinreach.envs.reach.env import UR5ReachEnv
from kinreach.envs.reach.task import MULTI_STEP


class UR5MultiStepEnv(UR5ReachEnv):
    """Multi-step reaching with a UR5: every action turns the joints by up to 5 degrees.

    ## Description
    A UR5 with a gripper stands before a table on which a red ball lies. Each action turns all six joints a little, at
    once. The task is that of the thesis's multi-step path planning (sections 3.4.2 to 3.4.5).

    ## Action Space
    `Box(-1, 1, (6,), float32)`: changes of the joint angles in units of 5 degrees. What is outside [-1, 1] is clipped.

    | Num | Action | Min | Max | Unit of the change |
    |-----|--------|-----|-----|--------------------|
    | 0 | change of shoulder_pan_joint | -1 | 1 | 5 degrees |
    | 1 | change of shoulder_lift_joint | -1 | 1 | 5 degrees |
    | 2 | change of elbow_joint | -1 | 1 | 5 degrees |
    | 3 | change of wrist_1_joint | -1 | 1 | 5 degrees |
    | 4 | change of wrist_2_joint | -1 | 1 | 5 degrees |
    | 5 | change of wrist_3_joint | -1 | 1 | 5 degrees |

    The change counts from where the joint stands, not from where it was sent.

    ## Observation Space
    As in `kinreach/UR5SingleStep-v0`; the joint angles are those of the present posture, the goal is the one measured
    in the start pose.

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
    As in `kinreach/UR5SingleStep-v0`, after every step. An impossible change (outside the limits, or held off by
    something) pays -100 and the episode goes on from where the arm stands.

    ## Starting State
    As in `kinreach/UR5SingleStep-v0`.

    ## Episode End
    Terminated when the goal is reached (d < 0.01 m and r_e < 0.15), unless `end_on_reached=False`; truncated after
    100 steps, or when the simulation diverges (`info["impossible_reason"]` begins with "diverged"). The thesis says
    both that an episode has 100 actions (section 3.4.5) and that it may end when the goal is reached (section 5.3);
    the default is the latter.

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
    | `end_on_reached` | `True` | whether reaching the goal ends the episode |

    ## Version History
    * v0: initial version
    """

    variant = MULTI_STEP

"""`kinreach/Lift-v0`: a gripper grasps an object and lifts it, in one decision or in small steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats
from kinreach._registration import LIFT, MAX_EPISODE_STEPS
from kinreach.envs._batch import NativeVectorEnv
from kinreach.envs._goals import GoalMethods
from kinreach.envs._lift.episodes import LiftEpisodes
from kinreach.envs._lift.lift_task import LiftOptions, LiftTask, grasping_batch
from kinreach.envs._options import with_options
from kinreach.envs._randomise import drawn_of
from kinreach.envs._single import ArmEnv, ForfeitEnv
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import OBJECTS, Grasping


def _objects(options: LiftOptions) -> int:
    return len(OBJECTS) if options.clutter else 1


@with_options(LiftOptions)
class LiftEnv(GoalMethods, ForfeitEnv, ArmEnv):
    """A UR grasps an object on the table and lifts it.

    ## Description
    A ball, a cube or an upright cylinder lies free on the table, under MuJoCo's dynamics. With `steps="single"` an
    action is a grasp, and a controller does the rest: the tip goes 0.15 m above the grasp, the fingers open by 0.10 m;
    down to the grasp; the fingers close in 0.5 s; up again; the arm holds still for 0.5 s. With `steps="multi"` an
    action turns the joints and moves the fingers a little, 25 times a second.

    ## Action Space
    `Box(-1, 1, (7,), float32)`. What is outside [-1, 1] is clipped. With `steps="single"`:

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 to 5 | posture of the grasp, one angle per joint | -1 | 1 | pi rad |
    | 6 | opening to which the fingers close | -1 (0 m) | 1 (0.16 m) | 0.08 m |

    With `steps="multi"`:

    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 to 5 | change of the joint angles | -1 | 1 | 5 degrees |
    | 6 | change of the opening | -1 | 1 | 8 mm |

    With `control="position"` the tip's place changes instead of the joints, in parts of 2 cm along the world's axes,
    and with `control="pose"` its direction too, by a rotation vector in parts of 2 degrees, as in
    `kinreach/UR5MultiStep-v0`, with `info["tip_share"]`.

    Changes count from where joints and fingers stand; they are sent to their servos in five parts.
    Each finger presses with 10 N for each millimetre that it is held off by, 120 N at most.

    ## Observation Space
    `Box(18,), float32`; with `clutter=True` 3 numbers more.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 to 2 | where the object's middle was seen, in the world | -10 | 10 | m |
    | 3 | angle of a cube's faces to the direction in which it lies, within pi/4; 0 of other shapes | -1 | 1 | rad |
    | 4 | size: radius, or half the edge | 0 | 1 | m |
    | 5 to 7 | 1 for its shape: ball, cube, cylinder | 0 | 1 | 1 |
    | 8 to 13 | joint angles | -3.641593 | 3.641593 | rad |
    | 14 | opening of the gripper | 0 | 2 | m |
    | 15 to 17 | from the tip to where the object was seen | -20 | 20 | m |
    | 18 to 20 | where the second object is (`clutter=True`) | -10 | 10 | m |

    With `steps="single"` the object is seen from the start pose, before every attempt; with `steps="multi"` in every
    step. Two observations are for one ball of one size, and the UR5: `observation="camera"` finds it in the rendered
    pictures of both cameras (0, 0, 0 where none finds it), once an episode in small steps; `"pixels"` gives the
    pictures, with depth, joint angles and opening, as in `kinreach/UR5SingleStep-v0`. Mass and friction are not
    observed.

    ## Rewards
    The sum of the terms in `info["reward_terms"]`, after every action: `distance`, minus the distance of tip and object
    [m] (in single steps before the fingers close); `closed`, 1 while the object touches both fingers; `height`, how
    high it is held, as a share of 0.10 m; `lifted`, 20 for success; `impossible`, -1 where the arm does not attain a
    posture or collides. In small steps the first three are a second: 0.04 of that a step. With `reward="sparse"` it is
    0 for success, else -1.

    ## Goals
    With `goal_env=True` observations are a `Dict` of `observation`, as above, `achieved_goal` and `desired_goal`. A
    goal is the height of the object's lowest point while it touches both fingers [m], and the time for which it is held
    0.10 m up [s]; (0.10, 0.5) is desired, and reached by as much or more. `compute_reward(achieved_goal, desired_goal,
    info)`, `compute_terminated` and `compute_truncated` take one step, or rows of them; the dense reward needs `info`.

    ## Starting State
    The arm stands in its start posture with the gripper open by 0.10 m. Place, turn, shape, size, mass and friction of
    the object are drawn from the options. `reset(options={"place": (x, y), "yaw": angle, "shape": name, "size": size,
    "mass": mass, "friction": friction})` sets any of them, the place on the table; `"view"` is where the cameras saw
    it earlier.

    ## Episode End
    Success: the object's lowest point is 0.10 m above the table for 0.5 s, and it touches both fingers and neither the
    table nor anything else that stands around. Single steps: the episode terminates with success or after `attempts`
    actions; before another attempt the arm goes home and looks again. Small steps: it terminates with success, or when
    the arm collides by more than 1 mm, which with `reward="sparse"` truncates it instead; Gymnasium truncates it after
    150 steps (`max_episode_steps`). A simulation that diverges ends it; `info["impossible_reason"]` then begins with
    "diverged".

    ## Info
    `reset` and `step` give the same entries, each of one type and shape. After a reset nothing is held, lifted or
    impossible, texts are empty except `shape`, and rewards are 0.

    | Key | Value |
    |-----|-------|
    | `goal`, `seen` | the object's middle when it was last looked at, and where the cameras saw it [m] |
    | `view` | the same for `reset(options=...)`: zeros where no camera saw it |
    | `yaw`, `shape`, `size`, `mass`, `friction` | of the object [rad, m, kg] |
    | `q`, `tip` | joint angles [rad], place of the tip [m] |
    | `distance` | of tip and object [m] |
    | `is_success`, `reached` | whether the object was lifted |
    | `cause` | what failed: `seen`, `reached`, `closed`, `slipped`, `dropped`; empty after success |
    | `held`, `clearance` | whether it touches both fingers; height of its lowest point above the table [m] |
    | `opening` | of the fingers [m] |
    | `position`, `rotation` | of the object after the action: its middle [m], and its rotation to the world |
    | `posture_error` | tilt of the tool plus angle between fingers and faces of a cube [rad] |
    | `status`, `impossible`, `impossible_reason` | how the action ended, and why it was impossible |
    | `attempts`, `move_s` | actions so far; simulated time [s] |
    | `reward_terms`, `reward_TERM` | terms of the reward, as a dictionary and one by one |

    ## Other Arms
    `arm=` takes any UR; one without a gripper gets the same on its flange. An action has one number for each joint.

    The `so101` has a jaw that turns beside a fixed one, with at most 1.9 N m: open by 0.07 m at the start, by 0.10 m at
    most. The size of an object is 0.03 m at most. The tip is `tcp`, 17 mm from the fixed jaw. Where the arm cannot
    point down above a grasp, it is tilted there.

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version
    """

    def _new_episodes(self, options: LiftOptions) -> LiftEpisodes:
        self._task = task = LiftTask(options)
        visual = options.render_mode is not None
        drawn = drawn_of(options.randomise)
        self._simulation = ArmSimulation(task.arm, visual=visual, objects=_objects(options), drawn=drawn)
        self._grasping = Grasping(self._simulation)
        return LiftEpisodes(task, self._grasping if options.backend == "mujoco" else None, 1)

    def accept(self, q: ArrayLike) -> bool:
        """Return whether a grasp's posture [rad], shape (n,), and the one above it are free of collisions."""
        postures = np.atleast_2d(np.asarray(q, dtype=np.float64))
        above = self._task.above(postures)
        return bool(np.isfinite(above).all()) and not self._task.checker.causes(np.vstack([postures, above])).any()

    def grasp_action(self, q: ArrayLike, opening: float) -> Floats:
        """Return the action of a single step for a grasp's posture [rad], shape (n,), and an opening [m]."""
        return self._task.action_for(np.asarray(q, dtype=np.float64), opening)

    def _follow(self) -> None:
        """Update the drawn scene where grasps are judged by geometry only."""
        episodes = self.episodes
        if episodes.world is None:
            only, limits = np.zeros(1, dtype=np.intp), self._simulation.controller
            self._grasping.reset(only, np.clip(episodes.q, limits.lower, limits.upper))
            places = episodes.goals - np.outer(episodes.kinds.size, (0.0, 0.0, 1.0))
            self._grasping.put(only, 0, episodes.kinds, places, episodes.yaws)


class LiftVectorEnv(GoalMethods, NativeVectorEnv):
    """A batch of `kinreach/Lift-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments, and how episodes start anew, are as of `NativeVectorEnv`. With `backend="warp"` all objects have one
    shape, and `device` is Warp's too.

    Attributes:
        task: What is to be done.
    """

    registered_limit = MAX_EPISODE_STEPS[LIFT]
    Options = LiftOptions

    def _new_episodes(self, options: LiftOptions, threads: int, device: str | None) -> LiftEpisodes:
        self.task = task = LiftTask(options)
        world = None
        if options.backend != "kinematic":
            world = grasping_batch(
                task.arm, self.num_envs, options, objects=_objects(options), threads=threads, device=device
            )
        return LiftEpisodes(task, world, self.num_envs)

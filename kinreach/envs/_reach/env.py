"""The thesis's task as Gymnasium environments: single-step and multi-step path planning."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_vector
from kinreach.envs._goals import GoalMethods
from kinreach.envs._options import with_options
from kinreach.envs._randomise import drawn_of
from kinreach.envs._reach.episodes import ReachEpisodes
from kinreach.envs._reach.reach_task import MULTI_STEP, SINGLE_STEP, ReachOptions, ReachTask, ReachVariant, tool_goal
from kinreach.envs._reach.space import SpaceOptions, SpaceTask
from kinreach.envs._reach.worlds import KinematicWorld, ReachWorld, SingleDynamicWorld
from kinreach.envs._single import ArmEnv, ForfeitEnv
from kinreach.kinematics import AxisGoal, PositionGoal
from kinreach.sim import ArmSimulation


class PostureEnv(ForfeitEnv):
    """An environment in which every action asks for a posture.

    Its episodes have a `ReachTask`, the arms' postures `q` and the `directions` of the tool.
    """

    @property
    def home(self) -> Floats:
        """The start posture [rad], shape (n,)."""
        return np.array(self.episodes.task.home)

    def posture_for(self, action: ArrayLike) -> Floats:
        """Return the posture [rad], shape (n,), that an action asks for: inverse of `action_for`.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        posture: Floats = self._targets(self.episodes.check_actions(action, None))[0]
        return posture

    def _targets(self, actions: Floats) -> Floats:
        """Return the postures of checked actions [rad], shape (1, n)."""
        targets: Floats = self.episodes.task.targets(self.episodes.q, actions)
        return targets

    def action_for(self, q: ArrayLike) -> Floats:
        """Return the action that takes the arm to a posture, or in several steps straight towards it.

        Args:
            q: Posture [rad], shape (n,).

        Returns:
            In double precision, shape (n,); outside [-1, 1] where a single step would leave the joint limits.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        now = self.episodes.q[0]
        action: Floats = self.episodes.task.action_for(now, as_vector("q", q, len(now)))
        return action

    def waypoints_to(self, q: Floats, target: Floats) -> list[Floats]:
        """Return the postures that a move passes, the last is the target [rad].

        Args:
            q: Where it begins [rad], shape (n,).
            target: [rad], shape (n,).
        """
        waypoints: list[Floats] = self.episodes.task.waypoints_to(q, target)
        return waypoints

    def ik_goal(self, position: ArrayLike) -> AxisGoal | PositionGoal:
        """Return the goal of a solver that brings the tip to a point of the world [m], shape (3,).

        The tool points down, or along the goal's direction; where goals have none, that of an arm with fewer than six
        joints is free.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        task = self.episodes.task
        return tool_goal(task.arm, position, self.episodes.directions[0], directed=task.directed)


class ReachEnv(GoalMethods, PostureEnv, ArmEnv):
    """One arm that reaches for a ball; the subclasses are the tasks, and describe them."""

    #: The task with the options.
    new_task: ClassVar[Any]
    goes_on = True

    def _new_episodes(self, options: ReachOptions) -> ReachEpisodes:
        self._task = task = self.new_task(options)
        visual = options.render_mode is not None
        self._simulation = ArmSimulation(
            task.arm, visual=visual, imperfections=options.imperfections, drawn=drawn_of(options.randomise)
        )
        self._world: ReachWorld = (
            SingleDynamicWorld(self._simulation)
            if options.backend == "mujoco"
            else KinematicWorld(task, 1, explain=True)
        )
        return ReachEpisodes(task, self._world)

    def _targets(self, actions: Floats) -> Floats:
        targets: Floats = self.episodes.targets(actions)[0]
        return targets

    @property
    def variant(self) -> ReachVariant:
        """Single- or multi-step."""
        return self._task.variant

    def accept(self, q: ArrayLike) -> bool:
        """Return whether a posture [rad], shape (n,), is free of collisions, and natural where that is rewarded.

        Collisions are judged with the option `margin`; natural is a posture error below the thesis's 0.15.
        In `kinreach/Reach-v0` with dynamics, the way there from where the arm stands must be free, too.

        Raises:
            InputError: Wrong shape, or not finite.
        """
        task, world = self._task, self._world
        if not (task.natural(q, self.episodes.directions[0]) and task.checker.free(q)):
            return False
        return not world.dynamic or task.way_free(world.q[0], np.asarray(q))

    def starts(self, rng: np.random.Generator, count: int) -> dict[str, Floats]:
        """Draw options of `reset` for a number of episodes, as the environment does, each of `count` rows.

        Those of a smaller number are the first of a larger one.

        Raises:
            InputError: The arm's goals are not in a box.
        """
        drawn = [self._task.training_starts(rng, 1, beyond=0.0) for _ in range(count)]
        return {name: np.concatenate([one[name] for one in drawn]) for name in (drawn[0] if drawn else ())}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode: the arm in its start pose, a new ball.

        Args:
            seed: Of the goals and of the cameras' noise.
            options: `"goal"`, shape (3,), puts the ball there, in the world frame [m]; `"q"`, shape (n,), starts the
                arm in this posture [rad]; `"view"` is the observation's goal block from an earlier measurement
                (zeros for a camera that did not find the ball): nothing is measured.

        Returns:
            The observation, and `info` as the class describes it.

        Raises:
            InputError: A seed that is not an integer at least 0, an unknown option, or one that is malformed.
        """
        return super().reset(seed=seed, options=options)

    def _follow(self) -> None:
        """Update the drawn scene where the world has no scene of its own."""
        if self._picture is not None and not self._world.dynamic:
            limits = self._simulation.controller
            self._simulation.reset(np.clip(self._world.q[0], limits.lower, limits.upper))
            self._simulation.place_ball(self.episodes.goals[0])


@with_options(ReachOptions)
class UR5SingleStepEnv(ReachEnv):
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
    `Box(13,), float32`. The goal is measured once per episode, in the start pose, in the optical frames of the cameras
    (x right, y down, z forward). `observation="geometric"` gives its true position; `"camera"` what is found in the
    rendered images (0, 0, 0 where no ball is found: no goal for that episode, and `info["ball_found"]` is False);
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
    | 6 | angle of shoulder_pan_joint | -3.641593 | 3.641593 | rad |
    | 7 | angle of shoulder_lift_joint | -3.641593 | 3.641593 | rad |
    | 8 | angle of elbow_joint | -3.641593 | 3.641593 | rad |
    | 9 | angle of wrist_1_joint | -3.641593 | 3.641593 | rad |
    | 10 | angle of wrist_2_joint | -3.641593 | 3.641593 | rad |
    | 11 | angle of wrist_3_joint | -3.641593 | 3.641593 | rad |
    | 12 | opening of the gripper | 0 | 2 | m |

    ## Rewards
    With d the distance from the tcp to the ball's centre and r_e the posture error (natural arm plus gripper angle,
    `kinreach.thesis`): r_d - r_e with r_d = 1 - d/2 for d >= 2 m, else 0.5 - 0.5 log2(d);
    10 - r_e for d < 0.01 m; 20 for d < 0.01 m and r_e < 0.15 (reached); -100 where the action is impossible: a target
    outside the limits, or one that the arm does not attain because something is in the way (`info["impossible_reason"]`
    names it). `info["reward_terms"]` has the terms `natural_arm`, `gripper_angle`, `distance` and `special`; their sum
    is the reward.

    `reward=` replaces all that by a function of yours (`kinreach.envs._reach.rewards`), or by `"sparse"`: 0 where the
    goal is reached, else -1.

    ## Goals
    With `goal_env=True` observations are a `Dict` of `observation` (joint angles and opening of the gripper),
    `achieved_goal` and `desired_goal`, float32. A goal is the place of the tip in the world [m], and where the reward
    is the thesis's the errors of natural arm and gripper angle [rad], of which 0 is desired; an achieved error counts
    as far as it exceeds the desired one. `compute_reward(achieved_goal, desired_goal, info)`, `compute_terminated` and
    `compute_truncated` take one step, or rows of them. Without `info` no action was impossible.

    ## Starting State
    The arm stands in [-pi/2, -pi/2, pi/2, -pi/2, -pi/2, 0] rad. The ball lies on the table, uniformly in
    0.30 <= x <= 0.65 m and -0.30 <= y <= 0.30 m of the world frame; `reset(options={"goal": (x, y, z)})` puts it
    elsewhere.

    ## Episode End
    Every episode terminates after its only action.

    ## Info
    `reset` and `step` give the same entries, each of one type and shape. After a reset `reached` and `impossible`
    are False, `impossible_reason` and `status` are empty, rewards are 0, and the target is where the arm stands.

    | Key | Value |
    |-----|-------|
    | `goal`, `seen` | where the ball is, and where the cameras put it (NaN if not found), in the world [m] |
    | `view`, `ball_found` | goal block of the observation; whether each camera found the ball |
    | `q`, `tip` | joint angles [rad], tip in the world [m] |
    | `distance`, `posture_error` | d [m] and r_e [rad] |
    | `reached`, `is_success` | the goal is reached |
    | `impossible`, `impossible_reason` | the action could not be executed, and why; empty where it could |
    | `status`, `impossible_code` | how the move ended, as a word and as a number |
    | `target`, `target_tip` | commanded posture [rad], and where the tip would be there [m] |
    | `move_s` | simulated time of the episode's moves [s] |
    | `reward_terms`, `reward_TERM` | terms of the reward, as a dictionary and one by one |

    ## Other Arms
    `arm=` takes any registered arm or an `ArmDescription`. An action has one number for each joint, mapped linearly
    onto its limits. An arm without observed cameras observes the goal in the world (3 numbers) instead of
    the six. The reward of arms with other joints than a UR's is minus the distance, and the goal is reached within
    `arm.workcell.reached_distance`.

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version
    """

    new_task = staticmethod(partial(ReachTask, variant=SINGLE_STEP))


@with_options(ReachOptions)
class UR5MultiStepEnv(ReachEnv):
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

    With `control="position"` an action is three numbers instead, the change of the tip's place along the world's axes
    in units of 5 cm, while the tool keeps the direction in which the episode began. `control="pose"` has three more: a
    rotation vector in the world in units of 5 degrees. The arm's closed form finds the posture, in the branch in which
    the arm is. Where the end of its way is out of reach, outside the joint limits, past a singularity, or more than
    0.5 rad away in a joint, the tip goes as far along it as six halvings find a posture, and the arm stays if none
    does: `info["tip_share"]` is the part that it was sent, from 0 to 1, and 0 after a reset.

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
    | 6 | angle of shoulder_pan_joint | -3.641593 | 3.641593 | rad |
    | 7 | angle of shoulder_lift_joint | -3.641593 | 3.641593 | rad |
    | 8 | angle of elbow_joint | -3.641593 | 3.641593 | rad |
    | 9 | angle of wrist_1_joint | -3.641593 | 3.641593 | rad |
    | 10 | angle of wrist_2_joint | -3.641593 | 3.641593 | rad |
    | 11 | angle of wrist_3_joint | -3.641593 | 3.641593 | rad |
    | 12 | opening of the gripper | 0 | 2 | m |

    ## Rewards
    As in `kinreach/UR5SingleStep-v0`, after every step. An impossible change (outside the limits, or held off by
    something) pays -100 and the episode goes on from where the arm stands.

    ## Goals
    As in `kinreach/UR5SingleStep-v0`.

    ## Starting State
    As in `kinreach/UR5SingleStep-v0`.

    ## Episode End
    Terminated when the goal is reached (d < 0.01 m and r_e < 0.15), unless `end_on_reached=False`; truncated by
    Gymnasium after 100 steps (`max_episode_steps`), or when the simulation diverges (`info["impossible_reason"]` begins
    with "diverged"). In the thesis an episode has 100 actions (section 3.4.5), or may end when the goal is reached
    (section 5.3); the default is the latter.

    ## Info
    As in `kinreach/UR5SingleStep-v0`.

    ## Other Arms
    As in `kinreach/UR5SingleStep-v0`; a joint turns by up to 5 degrees a step, or slides by up to 10 mm.

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version
    """

    new_task = staticmethod(partial(ReachTask, variant=MULTI_STEP))


@with_options(SpaceOptions)
class SpaceReachEnv(ReachEnv):
    """Reaching in space: a ball in the air, a tool direction, a start from anywhere near the start pose.

    ## Description
    The thesis's tasks are one plane of goals, one direction of the tool and one start. Here the ball is in a volume
    above the table, the tool is to point along a given direction, and the arm may start elsewhere; all else is as in
    `kinreach/UR5SingleStep-v0` (`steps="single"`) and `kinreach/UR5MultiStep-v0` (`steps="multi"`), for any arm with
    four joints or more.

    ## Action Space
    `Box(-1, 1, (n,), float32)` for an arm of n joints: joint targets, -1 and 1 being the limits of each, or changes in
    units of 5 degrees. `control="position"` and `"pose"` are as in `kinreach/UR5MultiStep-v0`.

    ## Observation Space
    `Box(6 + 3 + n + 1,), float32` with the two goal cameras (the UR5: 16 numbers), `Box(3 + 3 + n + 1,)` without. The
    goal is measured once per episode from the start pose, whatever the posture in which the arm then starts.

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 0 to 2 | goal in the front camera (without cameras: in the world) | m |
    | 3 to 5 | goal in the wrist camera (not without cameras) | m |
    | next 3 | direction in which the tool's z axis is to point, a unit vector in the world | 1 |
    | next n | joint angles | rad |
    | last | opening of the gripper | m |

    ## Rewards
    With d the distance from the tip to the ball's centre and a the angle between the tool and its direction: r_d - a
    with r_d as in the thesis; 10 - a for d < 0.01 m; 20 for d < 0.01 m and a < 0.15 rad (reached); -100 where the
    action is impossible. `info["reward_terms"]` has the terms `direction`, `distance` and `special`. No branch of the
    arm is preferred.

    `reward=` replaces it by a function of yours, which may take the angle as a fourth argument
    (`kinreach.envs._reach.rewards`), or by `"sparse"`.

    ## Goals
    As in `kinreach/UR5SingleStep-v0`; a goal is the place of the tip [m] and the tool's z axis, a unit vector, in the
    world.

    ## Starting State
    Goals are uniform in the arm's own region (the UR5: 0.30 <= x <= 0.65 m, -0.30 <= y <= 0.30 m), from the height of a
    ball that lies on the table to `goal_height` above. The direction is uniform on the sphere's cap within `tilt` of
    straight down. Joints are uniform within `start_spread` of the start pose, among the postures that collide with
    nothing. `reset(options={"goal": (x, y, z), "direction": (x, y, z), "q": q})` sets any of them.

    An arm with four or five joints, such as `so101`, cannot have any direction at any point. Drawn goals are those that
    it reaches without a collision, and their direction is the nearest to the drawn one that the tool can have there,
    still within `tilt`. What is set is taken as it is.

    ## Episode End
    As in the thesis's two tasks.

    ## Info
    As in `kinreach/UR5SingleStep-v0`, where `posture_error` is the angle a, and:

    | Key | Value |
    |-----|-------|
    | `direction` | the wanted direction of the tool, a unit vector in the world |

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version
    """

    new_task = SpaceTask

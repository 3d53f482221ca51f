"""`kinreach/ButtonPress-v0`: an arm under torque presses a button, as in the course report; one, or a native batch."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach._registration import BUTTON, MAX_EPISODE_STEPS
from kinreach.envs._batch import BatchPicture, NativeVectorEnv, Outcome
from kinreach.envs._button.episodes import ButtonEpisodes, ButtonOptions
from kinreach.envs._button.world import BatchTorqueWorld, ButtonState, SingleTorqueWorld
from kinreach.envs._options import with_options
from kinreach.envs._randomise import drawn_of
from kinreach.envs._single import SingleEnv
from kinreach.robots import ArmDescription
from kinreach.sim.inside import Scene


@with_options(ButtonOptions)
class ButtonPressEnv(SingleEnv):
    """A 3-DOF arm under torque that has to press a button.

    ## Description
    An arm with three joints, a turning base and two links that move in a vertical plane, stands on the floor under
    gravity. A red ball marks the target in the air around it, on top of a button. Each action changes the torques of
    the joints a little, and may press. The task is that of the course report "ME5418 - Gym Coding Report".

    ## Action Space
    `Discrete(54)`. Every joint has a control, 0 at first, to which an action adds -1, 0 or +1; it is kept within
    -10 ... 10. The torque of the joint is its control times its gear, constant during the step. Action a < 27 adds
    (a // 9 - 1, a // 3 % 3 - 1, a % 3 - 1); action a >= 27 adds the same as a - 27, and presses. Some of them:

    | Num | link_1_joint | link_2_joint | link_3_joint | Press |
    |-----|--------------|--------------|--------------|-------|
    | 0 | -1 | -1 | -1 | no |
    | 1 | -1 | -1 | 0 | no |
    | 2 | -1 | -1 | +1 | no |
    | 3 | -1 | 0 | -1 | no |
    | 9 | 0 | -1 | -1 | no |
    | 13 | 0 | 0 | 0 | no |
    | 26 | +1 | +1 | +1 | no |
    | 27 | -1 | -1 | -1 | yes |
    | 40 | 0 | 0 | 0 | yes |
    | 53 | +1 | +1 | +1 | yes |

    | Actuation | Gears [N m] | Joint damping [N m s/rad] | Armature [kg m^2] | Timestep [s] | Timesteps per step |
    |-----------|-------------|---------------------------|-------------------|--------------|--------------------|
    | `"tuned"` | 4, 8, 2.5 | 12, 20, 6 | 0.2, 0.2, 0.2 | 0.004 | 10 |
    | `"report"` | 100, 30, 10 | 686, 0, 0 | 6.52, 0, 0 | 0.002 | 2 |

    `"report"` is the course project's world on the day of its report. A contact between base and first link brakes
    joint 1 there; damping and armature of joint 1 stand for it, and joint 1 has no limit.
    `docs/studies/appendix/button.md` has the comparison, and why this is not the default.

    ## Observation Space
    `Box(19,), float32`, in the world frame (z up), in the report's order. Positions of the target stay within 0.75 m
    unless you set it elsewhere. The push state is 1 if the action that led here pressed, wherever that was. The
    controls are not observed, as in the report: add up your own actions if you need them, or set `controls=True`;
    they follow, -10 to 10. With `frames=n` the observations of the last n steps stand side by side,
    the newest first; before the first step all are alike.

    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | cosine of the angle of link_1_joint | -1 | 1 | 1 |
    | 1 | cosine of the angle of link_2_joint | -1 | 1 | 1 |
    | 2 | cosine of the angle of link_3_joint | -1 | 1 | 1 |
    | 3 | sine of the angle of link_1_joint | -1 | 1 | 1 |
    | 4 | sine of the angle of link_2_joint | -1 | 1 | 1 |
    | 5 | sine of the angle of link_3_joint | -1 | 1 | 1 |
    | 6 | target, x | -2 | 2 | m |
    | 7 | target, y | -2 | 2 | m |
    | 8 | target, z | -2 | 2 | m |
    | 9 | end effector, x | -2 | 2 | m |
    | 10 | end effector, y | -2 | 2 | m |
    | 11 | end effector, z | -2 | 2 | m |
    | 12 | velocity of link_1_joint | -10000 | 10000 | rad/s |
    | 13 | velocity of link_2_joint | -10000 | 10000 | rad/s |
    | 14 | velocity of link_3_joint | -10000 | 10000 | rad/s |
    | 15 | end effector minus target, x | -4 | 4 | m |
    | 16 | end effector minus target, y | -4 | 4 | m |
    | 17 | end effector minus target, z | -4 | 4 | m |
    | 18 | push state | 0 | 1 | 1 |

    ## Rewards
    With d the distance from the end effector to the target after the step, the sum of `info["reward_terms"]`:

    | Term | `"tuned"` | `"report"` | When |
    |------|-----------|------------|------|
    | `distance` | -d | -d | always |
    | `near` | 0.1 | 10 | d < 0.05 m |
    | `wrong_press` | -1 | -5 | pressed, and d >= 0.05 m |
    | `press` | 100 | 100 | the press counts |

    A press counts at d < 0.05 m: after the step with `actuation="tuned"`, before it with `"report"`. The report has the
    100, the radius and the distance; the other values of `"report"` are its repository's. With them a step near the
    target pays 10, so waiting there pays more than a press after eleven steps. The values of `"tuned"` are ours: a
    whole episode of waiting pays less than pressing at once.

    `reward=` takes a function of yours, `reward(distance, q, press)`, with stacks of k steps as
    `kinreach.envs._reach.rewards` describes: distances [m], joint angles [rad], whether the action pressed.

    ## Starting State
    Joint angles uniform within 0.1 rad of zero (the arm upright), joint velocities within 0.1 rad/s, controls 0. The
    target is uniform in one of four quadrants, and drawn again where the closed-form inverse kinematics has no posture
    within the joint limits:

    | Actuation | abs(x), abs(y) [m] | z [m] | Drawn again [%] |
    |-----------|--------------------|-------|-----------------|
    | `"tuned"` | 0.2 to 0.6 | 0.1 to 0.6 | 0.6 |
    | `"report"` | 0.1 to 0.75 | 0 to 0.75 | 12 |

    `fixed_target=True` keeps the first target in all episodes until `reset` is given a seed; `fixed_target=(x, y, z)`
    sets it. `reset(options={"goal": (x, y, z), "q": (q1, q2, q3)})` sets the target, and the posture to start in at
    rest, for one episode.

    ## Episode End
    Terminated when a press counts. Truncated by Gymnasium after 1000 steps (`max_episode_steps`), or when the
    simulation diverges (a joint faster than 10000 rad/s: `info["impossible"]`, False otherwise; the last good state is
    observed).

    ## Info
    `reset` and `step` give the same entries, each of one type and shape. After a reset nothing is pressed or
    impossible, `impossible_reason` is empty, and counts and rewards are 0.

    | Key | Value |
    |-----|-------|
    | `goal`, `tip` | target and end effector in the world [m] |
    | `distance`, `q` | between them [m]; joint angles [rad] |
    | `reached`, `is_success`, `pressed` | the press counts |
    | `wrong_press`, `wrong_presses`, `steps` | whether this press cost its penalty; numbers in this episode |
    | `impossible`, `impossible_reason`, `impossible_code` | whether the simulation diverged; why, else empty; 1 or 0 |
    | `energy` | sum over joints and time of torque² dt in this episode [N² m² s] |
    | `move_s` | simulated time in this episode [s] |
    | `reward_terms`, `reward_TERM` | terms of the reward, as a dictionary and one by one |

    ## Arguments

    <table of the options>

    ## Version History
    * v0: initial version
    """

    goes_on = True

    def _new_episodes(self, options: ButtonOptions) -> ButtonEpisodes:
        self._world = SingleTorqueWorld(
            options.arm, options.motors, visual=options.render_mode is not None, drawn=drawn_of(options.randomise)
        )
        return ButtonEpisodes(options, self._world)

    @property
    def _dynamics(self) -> Scene:
        return self._world

    @property
    def scene(self) -> Scene:
        """The simulation that `render` draws."""
        return self._world

    @property
    def arm(self) -> ArmDescription:
        """The 3-DOF arm, `arm3`."""
        return self.options.arm

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Start an episode: a new target, the arm upright and almost at rest.

        Args:
            seed: Of the targets and of the arm's state.
            options: `"goal"`, shape (3,), sets the target, in the world frame [m]; `"q"`, shape (3,), starts the arm
                in this posture [rad], at rest.

        Raises:
            InputError: A seed that is not an integer at least 0, an unknown or malformed option, a target out of reach.
        """
        return super().reset(seed=seed, options=options)

    def _follow(self) -> None:
        if self.render_mode == "human":
            self.render()

    def _answer(self, outcome: Outcome) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        answer = super()._answer(outcome)
        info = answer[-1]
        self._world.show(ButtonState.PRESSED if info["pressed"] else ButtonState(int(info["wrong_press"])))
        if self.render_mode == "human" and outcome.terminated[0]:
            self.render()
        return answer


class ButtonPressVectorEnv(NativeVectorEnv):
    """A batch of `kinreach/ButtonPress-v0`, equal to as many single ones with the seeds `seed`, `seed + 1`, ...

    Arguments, and how episodes start anew, are as of `NativeVectorEnv`.
    """

    registered_limit = MAX_EPISODE_STEPS[BUTTON]
    Options = ButtonOptions
    drawn = True

    def _new_episodes(self, options: ButtonOptions, threads: int, device: str | None) -> ButtonEpisodes:
        drawn = drawn_of(options.randomise)
        world = BatchTorqueWorld(options.arm, options.motors, self.num_envs, threads=threads, drawn=drawn)
        return ButtonEpisodes(options, world)

    def _new_picture(self) -> BatchPicture:
        episodes, scene = self.episodes, SingleTorqueWorld(self.options.arm, self.options.motors, visual=True)

        def show(index: int) -> None:
            q = episodes.world.q[[index]]
            scene.reset(np.zeros(1, dtype=np.intp), episodes.goals[[index]], q, np.zeros_like(q))

        return BatchPicture(scene, show, self.options)

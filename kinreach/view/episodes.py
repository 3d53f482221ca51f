"""Episodes as they are played back: recorded from the one loop of policies and environments, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from kinreach.baselines.rollout import Policy, rollout
from kinreach.checks import Floats
from kinreach.demo.tasks import TASKS, make_policy
from kinreach.errors import KinreachError
from kinreach.robots import ArmDescription
from kinreach.sim.simulation import ArmSimulation
from kinreach.summary import Trial
from kinreach.view.mujoco_scene import Contact, MujocoScene
from kinreach.view.names import length
from kinreach.vision.goal_view import CameraGoalView, GoalLook, has_goal_cameras

#: Frames per second of simulated time.
FPS = 25
#: More frames than this are not kept; every second one of those before is left out instead.
MOST_FRAMES = 3000
#: The ring around a ball that was found: its width [pixels] and colour.
RING, YELLOW = 3, (255, 255, 0)


class Stopped(Exception):
    """Who waited for the episode is gone."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A moment of an episode.

    Attributes:
        time: Simulated [s].
        step: How many actions have ended.
        poses: Of the scene's bodies, as `MujocoScene.take` has them, shape (k, 7).
        contacts: What touches.
    """

    time: float
    step: int
    poses: Floats
    contacts: tuple[Contact, ...]


@dataclass(frozen=True, eq=False)
class Step:
    """What the environment said after an action: reward and its terms, and what else is a number or a text."""

    reward: float
    terms: Mapping[str, float]
    distance: float
    impossible_reason: str


@dataclass
class Episode:
    """One episode.

    Attributes:
        scene: What is drawn.
        arm: Who acts.
        frames: From the reset to the end.
        steps: One an action.
        goal: Where it is in the world [m], shape (3,).
        trial: As `rollout` has it.
    """

    scene: MujocoScene
    arm: ArmDescription
    frames: list[Frame] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    goal: Floats = field(default_factory=lambda: np.zeros(3))
    trial: Trial = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """How it ended, in a sentence."""
        count = len(self.steps)
        after = f"after {count} step{'' if count == 1 else 's'}, {length(self.trial['distance'])} from the goal"
        if self.trial["reached"]:
            return f"Reached {after}."
        reason = self.trial.get("impossible_reason") or self.trial["status"]
        return f"Not reached {after}: {reason}." if self.trial["impossible"] else f"Not reached {after}."

    def frame_after(self, step: int) -> int:
        """Index of the first frame in which so many actions have ended; the last frame, if there are not so many."""
        return next((i for i, frame in enumerate(self.frames) if frame.step >= step), len(self.frames) - 1)

    def look(self) -> GoalLook | None:
        """What both cameras see of the ball from the start pose, and the circles that are found in it.

        Returns:
            None for an arm without cameras, and where nothing can be drawn.
        """
        if not has_goal_cameras(self.arm):
            return None
        simulation = ArmSimulation(self.arm)
        simulation.place_ball(self.goal)
        try:
            with CameraGoalView(self.arm) as view:
                return view.look(simulation)
        except KinreachError:
            return None


@dataclass(frozen=True)
class Recording:
    """Which episode is to be played.

    Attributes:
        name: Of the environment, a key of `kinreach.demo.tasks.TASKS`.
        policy: As `make_policy` takes it.
        arm: Who reaches; the button has an arm of its own.
        seed: Of the episode, and of what the policy draws.
        options: Of the environment.
    """

    name: str
    policy: str
    arm: ArmDescription
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)

    def play(self, *, simple: bool = False, stop: Event | None = None) -> Episode:
        """Play the episode to its end, and keep what is needed to show it.

        Args:
            simple: As `MujocoScene`.
            stop: Set where nobody waits any more.

        Raises:
            Stopped: `stop` was set.
            KinreachError: There is no such policy, it cannot act in that environment, or the arm cannot.
        """
        task = TASKS[self.name]
        options = {**self.options, "arm": self.arm} if task.solvers else self.options
        env = gym.make(task.name, render_mode="rgb_array", disable_env_checker=True, **options)
        try:
            policy = make_policy(self.policy, task, env, seed=self.seed)
            return _recorded(env, policy, {"seed": self.seed}, simple=simple, stop=stop or Event())
        finally:
            env.close()

    def program(self, arm: str) -> str:
        """Python code that plays the episode.

        Args:
            arm: An expression for the arm, such as `"'ur5'"`.
        """
        task = TASKS[self.name]
        names = [f"arm={arm}"] if task.solvers else []
        given = "".join(f", {option}" for option in (*names, *(f"{k}={v!r}" for k, v in self.options.items())))
        return "\n".join(
            [
                "import gymnasium as gym",
                "",
                "import kinreach",
                "from kinreach.baselines.rollout import rollout",
                "from kinreach.demo.tasks import TASKS, make_policy",
                *(["from kinreach.robots import ArmDescription, get_arm"] if "(" in "".join(names) else []),
                "",
                f"env = gym.make({task.name!r}{given})",
                f"policy = make_policy({self.policy!r}, TASKS[{self.name!r}], env, seed={self.seed})",
                f'for trial in rollout(env, policy, [{{"seed": {self.seed}}}]):',
                '    print(trial["reached"], trial["steps"], trial["distance"], trial["return"])',
                "env.close()",
                "",
            ]
        )


def circled(look: GoalLook, index: int) -> NDArray[np.uint8]:
    """What one of the two cameras saw, RGB, with a ring around the ball that was found."""
    picture = look.images[index].rgb.copy()
    fix = look.fixes[index]
    if fix is not None:
        u, v, r = fix.circle
        cv2.circle(picture, (round(u), round(v)), round(r) + RING, YELLOW, RING)
    return picture


def _recorded(
    env: gym.Env[Any, Any], policy: Policy, reset: Mapping[str, Any], *, simple: bool, stop: Event
) -> Episode:
    scene = env.get_wrapper_attr("scene")
    recorder = _Recorder(scene, Episode(MujocoScene(scene.model, simple=simple), env.get_wrapper_attr("arm")), stop)
    scene.watch = recorder.moving
    try:
        (recorder.episode.trial,) = rollout(env, policy, [reset], watch=recorder.stepped)
    finally:
        scene.watch = None
    return recorder.episode


class _Recorder:
    """Takes frames in the course of motions, and after every reset and step."""

    def __init__(self, scene: Any, episode: Episode, stop: Event) -> None:
        self.episode = episode
        self._scene, self._stop = scene, stop
        self._period, self._due = 1.0 / FPS, 0.0

    def moving(self) -> None:
        """In the course of a motion."""
        if self._scene.data.time >= self._due:
            self._take()

    def stepped(self, env: gym.Env[Any, Any], info: Mapping[str, Any]) -> None:
        """After a reset or a step."""
        episode = self.episode
        terms = info.get("reward_terms")
        if terms is None:
            episode.goal = np.array(info["goal"])
        else:
            numbers = {name: float(value) for name, value in terms.items()}
            reason = str(info.get("impossible_reason", ""))
            episode.steps.append(Step(sum(numbers.values()), numbers, float(info["distance"]), reason))
        self._take()

    def _take(self) -> None:
        if self._stop.is_set():
            raise Stopped
        now, frames = float(self._scene.data.time), self.episode.frames
        self._due = now + self._period
        poses, contacts = self.episode.scene.take(self._scene.data)
        frames.append(Frame(now, len(self.episode.steps), poses, tuple(contacts)))
        if len(frames) > MOST_FRAMES:
            del frames[1:-1:2]
            self._period *= 2

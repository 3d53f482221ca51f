"""Episodes to play back: recorded from `rollout`, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from kinreach._checks import STEP_LIMIT, Floats
from kinreach._statistics import Trial
from kinreach.baselines import rollout
from kinreach.compare.inside import arm_in
from kinreach.demo.inside import new_player as new_player  # public here
from kinreach.demo.inside import playable
from kinreach.errors import InputError, KinreachError
from kinreach.robots import ArmDescription
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import PosedScene
from kinreach.view._mujoco_scene import Contact, MujocoScene
from kinreach.view._names import length
from kinreach.view._snippet import robots
from kinreach.vision import CameraGoalView
from kinreach.vision.inside import GoalMeasurement

#: Frames per second of simulated time.
FPS = 25
#: Largest number of frames; beyond it every second one is left out.
MAX_FRAMES = 3000
#: Longest episode.
MAX_STEPS = 10_000
#: Entries of `info` that change during an episode.
CHANGING = {
    "cause", "clearance", "distance", "energy", "impossible_reason", "length", "move_s", "opening", "posture_error",
    "status", "time",
}  # fmt: skip
#: Beginnings of the names of others.
CHANGING_PARTS = ("error_", "reward_")
#: Width [pixels] and colour of the ring around a ball that was found.
RING, YELLOW = 3, (255, 255, 0)


class Stopped(Exception):
    """The episode was cancelled."""


@dataclass(frozen=True, eq=False)
class EpisodeFrame:
    """A moment of an episode.

    Attributes:
        time: Simulated [s].
        step: Number of actions that have ended.
        poses: Of the scene's bodies, as `MujocoScene.take` has them, shape (k, 7).
        contacts: Of the bodies.
        believed: Posture [rad] that the user assumes, shape (n,); None if that is the true one.
    """

    time: float
    step: int
    poses: Floats
    contacts: tuple[Contact, ...]
    believed: Floats | None


@dataclass(frozen=True, eq=False)
class Step:
    """The `info` after an action: reward, its terms, distance [m] if there is one, why impossible."""

    reward: float
    terms: Mapping[str, float]
    distance: float | None
    impossible_reason: str


@dataclass
class Episode:
    """One episode.

    Attributes:
        scene: The bodies that are drawn.
        arm: That acts, as the user assumes it to be.
        goal: First position in the world [m], shape (3,); None if there is not exactly one goal.
        trial: The row of `rollout`.
        facts: Texts and single numbers of the first `info`, by name.
    """

    scene: MujocoScene
    arm: ArmDescription
    frames: list[EpisodeFrame] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    goal: Floats | None = None
    trial: Trial = field(default_factory=dict)
    facts: Mapping[str, str | float] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        count = len(self.steps)
        after = f"after {count} step{'' if count == 1 else 's'}"
        if self.trial.get("distance") is not None:
            after += f", {length(self.trial['distance'])} from the goal"
        if self.trial["reached"]:
            return f"Reached {after}."
        if not self.trial["impossible"]:
            return f"Not reached {after}."
        return f"Not reached {after}: {self.trial.get('impossible_reason') or 'impossible'}."

    def frame_after(self, step: int) -> int:
        """Index of the first frame after a number of actions; that of the last frame if there are fewer."""
        return next((i for i, frame in enumerate(self.frames) if frame.step >= step), len(self.frames) - 1)

    def pause_after(self, index: int) -> float:
        """Return the time from a frame to the next [s]; a jump lasts as long as a motion."""
        times = [frame.time for frame in self.frames[index : index + 2]]
        return min(times[-1] - times[0], 1.0 / FPS) or 1.0 / FPS

    def measure_goal(self) -> GoalMeasurement | None:
        """Measure the ball with the cameras from the start pose; None without cameras, a goal or a renderer."""
        if self.goal is None or not self.arm.goal_cameras:
            return None
        simulation = ArmSimulation(self.arm)
        simulation.place_ball(self.goal)
        try:
            with CameraGoalView(self.arm) as view:
                return view.measure(simulation)
        except KinreachError:
            return None


@dataclass(frozen=True)
class EpisodeRequest:
    """An episode to play.

    Attributes:
        player: Name for `new_player`.
        arm: The arm that acts, if the environment has the option.
        options: Of the environment, in addition to those of its comparison.
    """

    name: str
    player: str
    arm: ArmDescription
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def _needed(self) -> dict[str, Any]:
        """Options that a trained player needs; none for `module:attribute`."""
        return playable(self.name).needed(self.player)

    @property
    def made_with(self) -> dict[str, Any]:
        """Options of the environment, except the arm."""
        options = {**playable(self.name).options, **self.options, **self._needed}
        options.pop("arm", None)
        return options

    def play(self, *, simple: bool = False, stop: Event | None = None) -> Episode:
        """Play the episode to its end and record it.

        Raises:
            Stopped: `stop` was set.
        """
        known = playable(self.name)
        options = {**self.made_with, **({"arm": self.arm} if "arm" in known.choices else {})}
        if known.drawn:
            options["render_mode"] = "rgb_array"
        if gym.spec(known.name).max_episode_steps is None:
            options = {STEP_LIMIT: MAX_STEPS, **options}
        env = gym.make(known.name, disable_env_checker=True, **options)
        try:
            player = new_player(self.player, env, seed=self.seed)
            recorder = _Recorder(env, simple=simple, stop=stop or Event())
            (trial,) = rollout(recorder, player, [{"seed": self.seed}], watch=recorder.watched)
            recorder.episode.trial = trial
            return recorder.episode
        finally:
            env.close()

    def program(self, arm: str) -> str:
        """Write Python code that plays the episode; `arm` is an expression such as `"'ur5'"`."""
        known = playable(self.name)
        names = [f"arm={arm}"] if "arm" in known.choices else []
        given = "".join(f", {option}" for option in (*names, *(f"{k}={v!r}" for k, v in self.made_with.items())))
        return "\n".join(
            [
                "import gymnasium as gym",
                "",
                "import kinreach",
                "from kinreach.baselines import rollout",
                *robots(*names),
                "from kinreach.view import new_player",
                "",
                f"env = gym.make({self.name!r}{given})",
                f"player = new_player({self.player!r}, env, seed={self.seed})",
                f'for trial in rollout(env, player, [{{"seed": {self.seed}}}]):',
                '    print(trial["reached"], trial["steps"], trial.get("distance"), trial["return"])',
                "env.close()",
                "",
            ]
        )


class EpisodeScene:
    """The scene of an episode: the environment's own, or one that follows its `info`.

    Args:
        env: The environment, after its reset.
        info: Of the reset.

    Attributes:
        scene: The scene.
        arm: The arm that is drawn: the believed one, if the true one differs.
        follows: Whether it has to follow `info`.

    Raises:
        InputError: The environment has no arm, or neither a scene nor a posture `q` in its info.
    """

    def __init__(self, env: gym.Env[Any, Any], info: Mapping[str, Any]) -> None:
        arm = arm_in(env)
        if arm is None:
            raise InputError(f"{_name(env)} cannot be drawn: it has no `arm`")
        self.arm, self.follows = arm, not env.has_wrapper_attr("scene")
        if self.follows and "q" not in info:
            raise InputError(f"{_name(env)} cannot be drawn: it has no `scene`, and no posture `q` in its info")
        self.scene: Any = PosedScene(arm) if self.follows else env.get_wrapper_attr("scene")

    def follow(self, info: Mapping[str, Any], *, time: float) -> None:
        """Move the scene to `info`'s state, if it has to; without a clock in it, at `time` [s]."""
        if self.follows:
            self.scene.put(info["q"], ball=info.get("goal"), time=float(info.get("time", time)))


def _name(env: gym.Env[Any, Any]) -> str:
    return env.spec.id if env.spec is not None else "the environment"


def circled(measured: GoalMeasurement, index: int) -> NDArray[np.uint8]:
    """Draw a ring around the ball that was found in the picture of a camera, RGB."""
    picture = measured.images[index].rgb.copy()
    fix = measured.fixes[index]
    if fix is not None:
        u, v, r = fix.circle
        cv2.circle(picture, (round(u), round(v)), round(r) + RING, YELLOW, RING)
    return picture


class _Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Record frames during motions and after every reset and step."""

    episode: Episode

    def __init__(self, env: gym.Env[Any, Any], *, simple: bool, stop: Event) -> None:
        super().__init__(env)
        self._simple, self._stop = simple, stop
        self._period, self._due = 1.0 / FPS, 0.0
        self._reward = 0.0

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        result = self.env.step(action)
        self._reward = float(result[1])
        return result

    def watched(self, env: gym.Env[Any, Any], info: Mapping[str, Any]) -> None:
        if not hasattr(self, "episode"):
            self._begin(info)
        else:
            terms = {name: float(value) for name, value in _terms(info).items()}
            reward = sum(terms.values()) if terms else self._reward
            distance = float(info["distance"]) if "distance" in info else None
            self.episode.steps.append(Step(reward, terms, distance, str(info.get("impossible_reason", ""))))
            self._reward = 0.0
        self._drawn.follow(info, time=len(self.episode.steps) / FPS)
        self._take()

    def _begin(self, info: Mapping[str, Any]) -> None:
        """Begin an episode in the environment's own scene, or in one that follows its `info`."""
        self._drawn = EpisodeScene(self.env, info)
        self._scene = self._drawn.scene
        self._believed = self.env.has_wrapper_attr("believed")
        self._scene.watch = self._moving
        goal = None if "goal" not in info else np.array(info["goal"], dtype=np.float64)
        facts = {name: value for name, value in info.items() if type(value) in (str, float) and _stays(name)}
        self.episode = Episode(
            MujocoScene(self._scene.model, simple=self._simple), self._drawn.arm, goal=goal, facts=facts
        )

    def _moving(self) -> None:
        if self._scene.data.time >= self._due:
            self._take()

    def _take(self) -> None:
        if self._stop.is_set():
            raise Stopped
        now, frames = float(self._scene.data.time), self.episode.frames
        self._due = now + self._period
        poses, contacts = self.episode.scene.take(self._scene.data)
        believed = self._scene.q if self._believed else None
        frames.append(EpisodeFrame(now, len(self.episode.steps), poses, tuple(contacts), believed))
        if len(frames) > MAX_FRAMES:
            del frames[1:-1:2]
            self._period *= 2


def _stays(name: str) -> bool:
    """Return whether an entry of `info` is of the whole episode."""
    return name not in CHANGING and not name.startswith(CHANGING_PARTS)


def _terms(info: Mapping[str, Any]) -> Mapping[str, Any]:
    """The reward's terms; also from entries `reward_…`."""
    prefix = "reward_"
    numbers = {name.removeprefix(prefix): value for name, value in info.items() if name.startswith(prefix)}
    return info.get("reward_terms", numbers)

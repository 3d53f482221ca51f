"""Touch a rolling ball with a model: at a sight, or where ball and arm can meet without a collision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, check_count
from kinreach.baselines.inside import LearnedPolicy, expert
from kinreach.compare._methods.turn_rate import TurnRateFit
from kinreach.envs.inside import moving as ball
from kinreach.kinematics import URKinematics
from kinreach.robots import THESIS_ARM

#: Time of a part of a frame [s].
PART = 1.0 / (ball.FRAMES * ball.PARTS)
#: How far ahead meetings are looked for [frames].
HORIZON = 40
#: Shares of the limit of acceleration with which a meeting must be possible: first with something left for corrections.
ACCELERATIONS = (0.94, 1.0)
#: The tip aims this far above the ball's centre, and the gripper is to be this far above the table [m].
ABOVE, CLEARANCE = 0.005, 0.003
#: Iterations of the search for postures; error that they may have [m].
ITERATIONS, MAX_MISS = 12, 1.5e-3
#: Frames after the earliest meeting at which it meets the ball instead if it can: it needs them if sights differ.
SPARE = 2
#: Ways that are checked for collisions in a decision; parts of a frame between checked postures.
MAX_WAYS, STRIDE = 40, 2
#: Frames after which the arm shall be on its way. Joints that follow it frame by frame lag; with more frames they are
#: ahead of it in between.
FRAMES_AHEAD = (3, 2, 1)
#: Shares of its limits that the arm may turn out to keep, and frames by which it may turn out to be late.
SHARES, FRAMES_LATE = np.linspace(1.0, 0.1, 91), np.arange(4)
#: With more noise than this [m], where collisions count, it goes along with the ball, reached after so many frames or
#: more, for at least so many, with the speed matched: joints may err by this time's way if their speed errs as much the
#: other way [s].
TRUSTED_NOISE = 5e-4
FRAMES_TO, FRAMES_ALONG, SPEED_ERROR = 3, 6, 0.1
#: A faster ball that leaves is gone before a second try: a way to it needs no way out if sights are less noisy [m/s].
LAST_TRY = 0.7
#: How many such ways are checked, and how far ahead they are looked for [frames].
MAX_ALONG, HORIZON_ALONG = 4, 60
#: Frames in which a policy acts before the planner does.
FIRST = 24
#: Where it waits: this share of the way from the ball to the middle of the area, this high above the ball [m].
TOWARDS_MIDDLE, WAITING = 0.35, 0.06
#: Without a way that is free, it keeps to the one that is free the longest if it is lower than this above the ball [m].
LOW_HEIGHT = 0.05


class _ClosedForm:
    """The closed form of the UR5 from the world to the tip, with the tool straight down."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._env: Any = env.unwrapped
        self._kinematics = URKinematics(THESIS_ARM, tip="tcp", base="world")

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Stay in the posture in which the episode starts."""
        self._target = np.array(info["q"])

    def _go(self, place: Floats) -> Floats:
        """Return the action for a place of the ball; the previous one if no posture reaches it."""
        posture = expert.tool_down_postures(self._kinematics, place[None])[0]
        if np.isfinite(posture).all():
            self._target = posture
        return self._target / math.pi


class FirstSight(_ClosedForm):
    """Go to where the ball was first seen: the open loop."""

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Solve for the first sight."""
        super().reset(observation, info)
        self._action = self._go(observation[ball.BALL])

    def act(self, observation: Any) -> Floats:
        """Return the action for the first sight again."""
        return self._action


class LastSight(_ClosedForm):
    """Go to where the ball was last seen."""

    def act(self, observation: Any) -> Floats:
        """Solve for the last sight."""
        return self._go(observation[ball.BALL])


class Interception(_ClosedForm):
    """Meet the ball as early as the joints' limits allow, in passing, on a way without collisions.

    A fit of constant speed and turn rate forecasts the ball. For each frame ahead, a posture is searched that the
    joints can have by then, with the tip at the ball and the gripper above the table. The arm follows the earliest way
    without a collision, else it waits above the ball. Where collisions count, it goes only to where it could still stop
    or rise, unless the ball leaves too fast for a second try. With noisy sights it also goes along with the ball where
    it can, so that its tip is at many places where the ball may be. Where collisions do not count, it checks no way.
    The share of the limits that the arm keeps, and how many frames it is late, are fitted to its joints' motions. The
    constants were chosen with balls of seeds 1 to 5.

    Args:
        env: `kinreach/Moving-v0`.
        noise: Standard deviation of a coordinate of a sight that is believed [m]; by default it is found.
        every: Frames from a decision to the next, as if one took so long; in between the arm goes on its way.
        first: Policy of the environment that acts in the first frames, in which the planner only sees.
        frames: How many these are.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        *,
        noise: float | None = None,
        every: int = 1,
        first: LearnedPolicy | None = None,
        frames: int = FIRST,
    ) -> None:
        super().__init__(env)
        self._every = check_count("every", every)
        self._first, self._frames = first, frames
        self._counts = self._env.options.collisions
        self._checker = ball.ur5_checker(self._env.options.margin)
        self._noise = noise
        self._known = {"speed": self._env.speed_limit, "acceleration": self._env.acceleration_limit}
        area = self._env.arm.workcell.goals
        self._low, self._high = np.array([area.x, area.y]).T
        self._table = self._env.height - self._env.arm.workcell.ball_radius if self._counts else -math.inf
        self._aim = self._env.height + (ABOVE if self._counts else 0.0)

    def reset(self, observation: Any, info: Mapping[str, Any]) -> None:
        """Forget the forecast of the last ball and the limits that its arm kept."""
        super().reset(observation, info)
        self._fit, self._time = TurnRateFit(self._noise), 0.0
        self._meeting: float | None = None
        self._limits, self._late, self._missed = dict(self._known), 0, np.zeros((len(FRAMES_LATE), len(SHARES)))
        self._last, self._sent = (np.array(info["q"]), np.zeros(6)), len(FRAMES_LATE) * [self._target]
        self._escape, self._fast = self._target, False
        self._followed: Floats | None = None

    def act(self, observation: Any) -> Floats:
        """Return the action of this frame on the way to the meeting."""
        q, v = np.array(observation[ball.ANGLES]), np.array(observation[ball.RATES])
        self._fit_arm(q, v)
        self._fit.see(self._time, observation[ball.BALL], float(observation[ball.AGE]))
        self._time += 1.0 / ball.FRAMES
        age = self._fit.age + self._late / ball.FRAMES  # when the action is done, after those that are on their way
        for target in self._sent[len(self._sent) - self._late :]:
            q, v = self._after_a_frame(q, v, target, self._limits)
        frame = round(self._time * ball.FRAMES) - 1
        if self._first is not None and frame < self._frames:
            self._target = math.pi * np.asarray(self._first.act(observation), dtype=float)
        elif frame % self._every == 0:
            self._followed = None
            self._choose(q, v, age, observation[ball.BALL])
        elif self._followed is not None and len(self._followed) > ball.PARTS:
            self._follow(q, v, self._followed[ball.PARTS :])
        if self._counts and not (self._fast and self._fit.noise <= TRUSTED_NOISE):
            self._keep_a_way_out(q, v)
        self._sent.append(self._target)
        return self._target / math.pi

    def _choose(self, q: Floats, v: Floats, age: float, seen: Floats) -> None:
        """Choose the target that leads towards the meeting.

        Args:
            q: Joint angles when the action is done [rad], shape (6,).
            v: Their speeds [rad/s], shape (6,).
            age: Time from the last sight until then [s].
            seen: That sight [m], shape (3,).
        """
        if not self._fit.moving:
            self._wait(q, v, seen[:2] + TOWARDS_MIDDLE * ((self._low + self._high) / 2 - seen[:2]))
            return
        parts: Any = ball.PARTS * np.arange(1, HORIZON_ALONG + 1)
        xy = self._fit.forecast(age + PART * parts)
        outside = ((xy < self._low) | (xy > self._high)).any(axis=1)
        self._fast = bool(np.linalg.norm(xy[1] - xy[0]) * ball.FRAMES > LAST_TRY and outside.any())
        xy = xy[: max(int(outside.argmax()) if outside.any() else len(xy), 1)]
        noisy = self._counts and self._fit.noise > TRUSTED_NOISE
        if noisy and (along := self._along(q, v, xy)) is not None:
            place, speed = along[ball.PARTS - 1], (along[ball.PARTS] - along[ball.PARTS - 2]) / (2.0 * PART)
            self._target = self._towards(q, v, place + SPEED_ERROR * speed, ball.PARTS, SPEED_ERROR)
            return
        count = min(len(xy), HORIZON)
        way, until = self._way(q, v, xy[:count], parts[:count])
        low = self._kinematics.fk(q)[2, 3] < self._env.height + LOW_HEIGHT
        if way is not None and (until >= len(way) or (low and until >= ball.PARTS)):
            self._follow(q, v, way)
        else:
            self._wait(q, v, xy[min(HORIZON // 3, count - 1)])

    def _keep_a_way_out(self, q: Floats, v: Floats) -> None:
        """Rise, stop or take the last way out, if the arm could not stop or rise a frame later without a collision.

        Ways out are checked for as long as `_is_free` looks ahead.
        """
        for target in (self._target, *self._ways_out(q, v), self._escape):
            if self._is_free(q, v, target, ball.PARTS):
                after = self._after_a_frame(q, v, target, self._limits)
                for escape in self._ways_out(*after):
                    if self._is_free(*after, escape):
                        self._target, self._escape = target, escape
                        return
        if not self._is_free(q, v, self._target):
            self._target = self._escape

    def _ways_out(self, q: Floats, v: Floats) -> list[Floats]:
        """Return targets that stop the arm: above where it would stop, if a posture is there, and just there."""
        stop = np.clip(q + v * np.abs(v) / (2.0 * self._limits["acceleration"]), -math.pi, math.pi)
        above = self._above(self._kinematics.fk(stop)[:2, 3])
        return [above, stop] if np.isfinite(above).all() else [stop]

    def _above(self, xy: Floats) -> Floats:
        """Return the posture in which the arm waits above a place of the area; not finite if none is there."""
        place = np.clip(xy, self._low + ball.INSIDE, self._high - ball.INSIDE)
        return expert.tool_down_postures(self._kinematics, np.array([[*place, self._env.height + WAITING]]))[0]

    def _along(self, q: Floats, v: Floats, xy: Floats) -> Floats | None:
        """Return the earliest way that ends in going along with the ball, tool down, for some frames, if one is free.

        Joints go there with an acceleration that changes steadily, and arrive with the speed that goes along.

        Args:
            q: Joint angles [rad], shape (6,).
            v: Their speeds [rad/s], shape (6,).
            xy: Of the ball after each frame [m], shape (n, 2).

        Returns:
            Joint angles after each part of a frame [rad], shape (m, 6).
        """
        goal = expert.tool_down_postures(self._kinematics, np.column_stack([xy, np.full(len(xy), self._aim)]))
        possible = np.isfinite(goal).all(axis=1)
        goal = goal if possible.all() else goal[: int(possible.argmin())]
        if len(goal) < FRAMES_TO + FRAMES_ALONG:
            return None
        time, speed = np.arange(1, len(goal) + 1)[:, None] / ball.FRAMES, np.gradient(goal, 1.0 / ball.FRAMES, axis=0)
        first = 6.0 * (goal - q) / time**2 - (4.0 * v + 2.0 * speed) / time
        last = -6.0 * (goal - q) / time**2 + (2.0 * v + 4.0 * speed) / time
        middle = v + (3.0 * first + last) * time / 8.0
        most = np.abs([first, last]).max(axis=0) <= ACCELERATIONS[0] * self._limits["acceleration"]
        within = (most & (np.abs([middle, speed]).max(axis=0) <= self._limits["speed"])).all(axis=1)
        within[: FRAMES_TO - 1] = within[len(goal) - FRAMES_ALONG :] = False
        for index in np.flatnonzero(within)[:MAX_ALONG]:
            tau, end = PART * np.arange(1, (index + 1) * ball.PARTS + 1)[:, None], time[index]
            there = q + v * tau + first[index] * tau**2 / 2.0 + (last[index] - first[index]) * tau**3 / (6.0 * end)
            frames = index + np.arange(1, FRAMES_ALONG * ball.PARTS + 1) / ball.PARTS
            along = np.array([np.interp(frames, np.arange(len(goal)), joint) for joint in goal.T]).T
            way = np.concatenate([there, along])
            if not self._collides(way[STRIDE - 1 :: STRIDE]).any():
                return way
        return None

    def _fit_arm(self, q: Floats, v: Floats) -> None:
        """Fit the share of the limits, and the frames that the arm is late, to its motions in all frames so far."""
        if self._time:
            limits = {name: SHARES[:, None] * limit for name, limit in self._known.items()}
            sent = np.array(self._sent)[-1 - FRAMES_LATE][:, None]
            end, _ = self._after_a_frame(*self._last, sent, limits)
            self._missed += ((end - q) ** 2).sum(axis=-1)
        late, share = np.unravel_index(self._missed.argmin(), self._missed.shape)
        self._last, self._late = (q, v), int(FRAMES_LATE[late])
        self._limits = {name: SHARES[share] * limit for name, limit in self._known.items()}

    @staticmethod
    def _after_a_frame(q: Floats, v: Floats, target: Floats, limits: Mapping[str, Any]) -> tuple[Floats, Floats]:
        """Return where joints are a frame later, and how fast."""
        for _ in range(ball.PARTS):
            q, v = ball.moved(q, v, target, PART, **limits)
        return q, v

    def _way(self, q: Floats, v: Floats, xy: Floats, parts: Any) -> tuple[Floats | None, int]:
        """Return the way to the earliest meeting without a collision, else the one that is free the longest.

        Args:
            q: Joint angles [rad], shape (6,).
            v: Their speeds [rad/s], shape (6,).
            xy: Of the ball [m], shape (n, 2).
            parts: Parts of a frame after which it is there, shape (n,).

        Returns:
            Joint angles after each part [rad], shape (m, 6), or None; number of parts that are free.
        """
        places = np.column_stack([xy, np.full(len(xy), self._aim)])
        down = expert.tool_down_postures(self._kinematics, places)
        start, tried = np.where(np.isfinite(down), down, q), 0
        longest: tuple[Floats | None, int] = (None, 0)
        for share in ACCELERATIONS:
            postures, misses = self._postures(*self._bounds(q, v, parts, share), places, start)
            possible = np.flatnonzero(misses < MAX_MISS)
            if not len(possible):
                continue
            wanted = possible[0] + SPARE if self._meeting is None else (self._meeting - self._time) * ball.FRAMES
            for index in sorted(possible, key=lambda frame: (frame < wanted - 0.5, frame))[: MAX_WAYS - tried]:
                way = self._steady(q, v, postures[index], int(parts[index]))
                checked = np.append(np.arange(STRIDE - 1, len(way) - 1, STRIDE), len(way) - 1)
                hits = np.flatnonzero(self._collides(way[checked]))
                if not len(hits):
                    self._meeting = self._time + index / ball.FRAMES
                    return way, len(way)
                longest = max(longest, (way, int(checked[hits[0]])), key=lambda found: found[1])
                tried += 1
        self._meeting = None
        return longest

    def _wait(self, q: Floats, v: Floats, xy: Floats) -> None:
        """Go above a place, continue, or stop: the first that does not collide."""
        posture = self._above(xy)
        if np.isfinite(posture).all() and self._is_free(q, v, posture):
            self._target = posture
        elif not self._is_free(q, v, self._target):
            self._target = self._ways_out(q, v)[-1]

    def _is_free(self, q: Floats, v: Floats, target: Floats, parts: int = 8 * ball.PARTS) -> bool:
        """Return whether the joints can move towards a target for some parts of a frame without a collision."""
        way = []
        for _ in range(parts):
            q, v = ball.moved(q, v, target, PART, **self._limits)
            way.append(q)
        return not self._collides(np.array(way[STRIDE - 1 :: STRIDE])).any()

    def _collides(self, postures: Floats) -> NDArray[np.bool_]:
        """Return which postures collide, shape (n, 6) to (n,): none where collisions do not count."""
        return self._checker.causes(postures) > 0 if self._counts else np.zeros(len(postures), dtype=np.bool_)

    def _follow(self, q: Floats, v: Floats, way: Floats) -> None:
        """Choose the target that leads each joint to where the way is some frames later, the most that are free."""
        self._followed = way
        for frames in FRAMES_AHEAD:
            parts = min(frames * ball.PARTS, len(way))
            self._target = self._towards(q, v, way[parts - 1], parts)
            if self._is_free(q, v, self._target, parts):
                break

    def _towards(self, q: Floats, v: Floats, goal: Floats, parts: int, ahead: float = 0.0) -> Floats:
        """Return the angles to go to so that each joint passes its goal after parts of a frame, shape (6,).

        With a time `ahead` [s], so that its angle and `ahead` times its speed are then the goal.
        """
        low, high, joints = np.full(6, -math.pi), np.full(6, math.pi), np.arange(6)
        for _ in range(3):  # where a joint is then grows with the angle that it goes to
            tried = np.linspace(low, high, 33)
            end, speed = np.tile(q, (33, 1)), np.tile(v, (33, 1))
            for _ in range(parts):
                end, speed = ball.moved(end, speed, tried, PART, **self._limits)
            first = (end + ahead * speed < goal - 1e-6).sum(axis=0)
            low, high = tried[np.maximum(first - 1, 0), joints], tried[np.minimum(first, 32), joints]
        return np.asarray(high)

    def _steady(self, q: Floats, v: Floats, goal: Floats, parts: int) -> Floats:
        """Return the way on which each joint passes its goal after so many parts, shape (parts, 6).

        A joint accelerates steadily all the way, or if a limit forbids that, as much as it may and then no more.
        """
        speed, most = self._limits["speed"], self._limits["acceleration"]
        time, tau = parts * PART, PART * np.arange(1, parts + 1)[:, None]
        beyond = goal - q - v * time  # what the present speed does not bring
        steady = 2.0 * beyond / time**2
        limited = (np.abs(v + steady * time) > speed) | (np.abs(steady) > most)
        gain = most * time - np.sqrt(np.maximum((most * time) ** 2 - 2.0 * most * np.abs(beyond), 0.0))
        ramp = np.abs(np.clip(v + np.sign(beyond) * gain, -speed, speed) - v) / most
        acceleration = np.where(limited, np.sign(beyond) * most, steady)
        ramp = np.where(limited, np.maximum(ramp, 1e-9), time)
        during = np.minimum(tau, ramp)
        after = (v + acceleration * ramp) * np.maximum(tau - ramp, 0.0)
        return np.asarray(q + v * during + acceleration * during**2 / 2.0 + after)

    def _bounds(self, q: Floats, v: Floats, parts: Any, share: float) -> tuple[Floats, Floats]:
        """Return the least and greatest angles that the joints can have after parts of a frame, each shape (n, 6)."""
        gain = share * self._limits["acceleration"] * PART * np.arange(1, parts[-1] + 1)[:, None]
        limit = self._limits["speed"]
        least, most = (
            q + PART * np.cumsum(np.clip(v + side * gain, -limit, limit), axis=0)[parts - 1] for side in (-1, 1)
        )
        return np.clip(least, -math.pi, math.pi), np.clip(most, -math.pi, math.pi)

    def _postures(self, low: Floats, high: Floats, places: Floats, start: Floats) -> tuple[Floats, Floats]:
        """Return postures within bounds with the tips at places and the gripper above the table, and their errors.

        Levenberg-Marquardt, all at once; joints at a bound that would go beyond it are held.

        Args:
            low: Least angles [rad], shape (n, 6).
            high: Greatest angles [rad], shape (n, 6).
            places: [m], shape (n, 3).
            start: Where the search begins [rad], shape (n, 6).

        Returns:
            Joint angles [rad], shape (n, 6); distance from the place plus depth below `CLEARANCE` [m], shape (n,).
        """
        q = np.clip(start, low, high)
        best, least, rows = q.copy(), np.full(len(q), np.inf), np.arange(len(q))
        for _ in range(ITERATIONS):
            T, J = self._kinematics.fk(q), self._kinematics.jacobian(q)
            arms = np.einsum("nij,kj->nki", T[:, :3, :3], expert.GRIPPER)
            depth = np.maximum(self._table + CLEARANCE - arms[:, :, 2] - T[:, 2:3, 3], 0.0)
            error = np.concatenate([places - T[:, :3, 3], 1.3 * depth], axis=1)
            missed = np.linalg.norm(error[:, :3], axis=1) + depth.max(axis=1)
            better = missed < least[rows]
            best[rows[better]], least[rows[better]] = q[better], missed[better]
            left = missed >= MAX_MISS / 3
            if not left.any():
                break
            rows, q, low, high, places, error, J, arms, depth = (
                values[left] for values in (rows, q, low, high, places, error, J, arms, depth)
            )
            heights = J[:, None, 2] + arms[:, :, 1, None] * J[:, None, 3] - arms[:, :, 0, None] * J[:, None, 4]
            A = np.concatenate([J[:, :3], heights * (depth > 0.0)[:, :, None]], axis=1)
            pull = np.einsum("nij,ni->nj", A, error)
            held = ((q >= high) & (pull > 0.0)) | ((q <= low) & (pull < 0.0))
            A, pull = np.where(held[:, None], 0.0, A), np.where(held, 0.0, pull)
            step = np.linalg.solve(A.transpose(0, 2, 1) @ A + 1e-4 * np.eye(6), pull[:, :, None])[:, :, 0]
            q = np.clip(q + np.clip(step, -0.5, 0.5), low, high)
        return best, least

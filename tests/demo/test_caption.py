"""What is written into films stays: places, sizes, colours and words."""

from types import SimpleNamespace

import gymnasium as gym
import mujoco
import numpy as np

from kinreach.demo import _caption, _cli
from kinreach.demo._caption import Caption, Moment
from kinreach.robots import get_arm
from kinreach.sim._scene import scene_model
from kinreach.vision import RGBDImage
from kinreach.vision._circles import Circle
from kinreach.vision.inside import BallFix, GoalMeasurement

#: The strokes for a distance, in order.
BOX = "rounded_rectangle (18, 18, 318, {bottom}) 8 white"
NAME = ["ellipse (32, 35, 46, 49) {colour}", "text (56, 28) {name} 22 Bold {ink}"]
VIEW = [
    "rounded_rectangle (774, 18, 942, 212) 8 white",
    "ellipse (784, 28, 932, 176) #b8b8b8 1",
    "ellipse (821, 65, 895, 139) #b8b8b8 1",
    "line (849, 102, 867, 102) #dc0a08 3",
    "line (858, 93, 858, 111) #dc0a08 3",
]


class Pen:
    """Writes down what is drawn."""

    def __init__(self, image):
        self.lines = []
        Pen.last = self

    def textlength(self, text, font):
        return 10 * len(text)

    def __getattr__(self, name):
        def draw(place, *more, **named):
            font = named.pop("font", None)
            shown = [f"{font.size}{' Bold' * ('Bold' in font.path)}"] if font else []
            corners = ", ".join(f"{round(float(each), 3):g}" for each in place)
            self.lines.append(" ".join(map(str, (name, f"({corners})", *more, *shown, *named.values()))))

        return draw


def written(monkeypatch, caption, moment):
    monkeypatch.setattr(_caption.ImageDraw, "Draw", Pen)
    caption.write(np.zeros((540, 960, 3), dtype=np.uint8), moment)
    return Pen.last.lines


def named(caption):
    return [line.format(colour=caption.colour, name=caption.name, ink=_caption.INK) for line in NAME]


def test_a_frame_without_a_distance_has_a_name(monkeypatch):
    caption = Caption("button")
    ink, box = _caption.INK, BOX.format(bottom=100)
    assert written(monkeypatch, caption, None) == [box, *named(caption), f"text (32, 62)  22 {ink}"]


def test_the_tip_is_enlarged_in_the_smallest_circle_that_it_is_in(monkeypatch):
    caption, ink = Caption("closed-form"), _caption.INK
    caption.verdict, caption.reached = "reached", True
    cases = {
        0.5: ("0.50", "1", 37.0), 1.0: ("1.00", "1", 74.0), 1.5: ("1.50", "10", 11.1), 10.0: ("10.0", "10", 74.0),
        40.0: ("40.0", "100", 29.6), 100.0: ("100", "100", 74.0),
    }  # fmt: skip
    for mm, (number, radius, away) in cases.items():
        lines = written(monkeypatch, caption, Moment(np.array([1e-3 * mm, -0.5e-3 * mm]), 1e-3 * mm))
        text = f"tip, circle: {radius} mm"
        x, y = 858 + away, 102 + 0.5 * away
        assert lines == [
            BOX.format(bottom=134), *named(caption), f"text (32, 62) distance {number} mm 22 {ink}",
            "text (32, 96) reached 22 Bold #1a7f37", *VIEW,
            f"ellipse ({x - 6:g}, {y - 6:g}, {x + 6:g}, {y + 6:g}) {caption.colour}",
            f"text ({858 - 5 * len(text):g}, 186) {text} 15 {ink}",
        ]  # fmt: skip
    caption.reached = False
    lines = written(monkeypatch, caption, Moment(np.zeros(2), 0.1001))
    assert lines[-1] == "text (32, 96) reached 22 Bold #b42318"  # too far away to be enlarged


def test_what_the_cameras_found_is_circled():
    """A wide yellow ring around the ball, in the picture of the camera that found it."""
    black = np.zeros((540, 960, 3), dtype=np.uint8)
    picture = RGBDImage(np.full((360, 640, 3), 90, dtype=np.uint8), np.ones((360, 640), dtype=np.float32))
    fix = BallFix(Circle(320.0, 180.0, 40.0), np.array([0.0, 0.0, 1.0]))
    caption = Caption("closed-form")
    caption.see(("front", "wrist"), GoalMeasurement(np.zeros(6), np.array([True, False]), (fix, None), 2 * (picture,)))
    frame = caption.write(black, None)
    rows, columns = np.nonzero((frame == (255, 212, 0)).all(axis=2))
    assert len(rows) > 200
    u, v = columns.mean(), rows.mean()
    assert (frame[round(v), round(u)] == 90).all()
    np.testing.assert_allclose(np.hypot(columns - u, rows - v), 40.0 * 240 / 640 + 4, atol=2.5)  # a picture is 240 wide
    caption.see(("front", "wrist"), None)
    assert not (caption.write(black, None)[200:] > 0).any()


def test_a_caption_follows_the_ball_the_object_or_the_goal():
    """What is right of and above the goal as the camera sees it; an object counts before a goal without a ball."""
    model = scene_model(get_arm("ur5-thesis"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.mocap_pos[model.body("ball").mocapid[0]] = (0.5, 0.1, 0.0)
    caption = Caption("closed-form")
    caption.follow(SimpleNamespace(model=model, data=data))
    tip = data.site_xpos[model.nsite - 1]
    right, up, _ = data.camera("overview").xmat.reshape(3, 3).T
    away = tip - (0.5, 0.1, 0.0)
    (moment,) = caption.moments(1)
    np.testing.assert_allclose(moment.offset, [away @ right, away @ up])
    np.testing.assert_allclose(moment.distance, np.linalg.norm(away))
    assert caption.moments(1) == []
    bare = scene_model(get_arm("arm3"))
    data = mujoco.MjData(bare)
    mujoco.mj_forward(bare, data)
    has_ball = mujoco.mj_name2id(bare, mujoco.mjtObj.mjOBJ_BODY, "ball") >= 0
    caption.follow(SimpleNamespace(model=bare, data=data))
    assert (caption.moments(1) == [None]) is not has_ball


class Frames(gym.Env):
    """Episodes of three steps with two frames each."""

    metadata = {"render_fps": 50}  # noqa: RUF012 (declared by Gymnasium)
    action_space = observation_space = gym.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        self.left = 3
        return 0, {"goal": np.zeros(3)}

    def step(self, action):
        self.left -= 1
        over = self.left == 0
        return 0, 0.0, over, False, {"is_success": over and action == 1, "impossible": action == 0}

    def render(self):
        return [f"frame {self.left} {index}" for index in range(2)]


def test_the_last_frame_of_an_episode_stands_still_with_its_verdict(monkeypatch):
    for action, verdict in ((1, "pressed"), (0, "impossible")):
        caption, film = Caption("ppo", done="pressed"), []
        monkeypatch.setattr(caption, "moments", lambda count: [f"moment {index}" for index in range(count)])
        monkeypatch.setattr(caption, "write", lambda frame, moment, own=caption: (frame, moment, own.verdict))
        watched = _cli._Watched(Frames(), [], SimpleNamespace(add=film.append, full=False), caption, 25)
        watched.limit = 9
        for _ in range(2):
            watched.reset()
            assert caption.verdict == ""
            steps = [watched.step(action) for _ in range(3)]
            assert [step[2:4] for step in steps] == [(False, False), (False, False), (True, False)]
        frames = [(f"frame {left} {index}", f"moment {index}", "") for left in (1, 0) for index in (0, 1)]
        assert film == 2 * [*frames, *[("frame 0 1", "moment 1", verdict)] * 20]  # every other step is filmed
        assert caption.reached is (action == 1)

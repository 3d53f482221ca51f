"""What cannot be drawn is refused by name, before anything is drawn; above all what would be drawn without a word."""

import math

import numpy as np
import pytest

from kinreach import plots
from kinreach.errors import InputError

AT = np.linspace(0.1, 0.9, 5)
ERRORS = {"a": (np.column_stack([AT, AT]), AT)}
REWARDS = {"a": plots.RewardMap(AT, AT, np.zeros((5, 5)))}
CURVES = {"p": {"a": [(AT, AT)]}}
PICTURE = np.zeros((9, 9, 3), np.uint8)
PENTAGON = plots.pentagon_of([-1.57, -1.57, 1.57, -1.57, -1.57, 0.0], ground=-0.2)
CASES = {
    "columns must be at least 1, got 0": [
        lambda: plots.draw_pictures({"a": PICTURE}, columns=0),
        lambda: plots.draw_error_maps(ERRORS, title="", columns=0),
    ],
    "width must be": [lambda: plots.draw_pictures({"a": PICTURE}, width=math.nan)],
    "must be uint8 of shape": [
        lambda: plots.draw_pictures({"a": np.zeros((0, 9, 3), np.uint8)}),
        lambda: plots.draw_pictures({"a": np.zeros((0, 9))}),
        lambda: plots.draw_pictures({"a": [[1, 2]]}),
        lambda: plots.draw_pictures({"a": np.ones((9, 9), np.longdouble)}),
    ],
    "must be at most 20 times as high as wide": [lambda: plots.draw_pictures({"a": np.ones((900, 1))})],
    "units must be a mapping": [lambda: plots.draw_pictures({"a": PICTURE}, units="m")],
    "zoom must be": [lambda: plots.draw_camera_steps({"a": PICTURE}, (4, 4, 2), title="", zoom=math.nan)],
    "radius of a circle must be positive, got 0": [
        lambda: plots.draw_camera_steps({"a": PICTURE}, (4, 4, 0), title="")
    ],
    "marked must be a collection of names": [
        lambda: plots.draw_camera_steps({"a": PICTURE}, (4, 4, 2), title="", marked=b"a"),
        lambda: plots.draw_camera_steps({"a": PICTURE}, (4, 4, 2), title="", marked=np.array(1.0)),
    ],
    "widest must be": [lambda: plots.draw_posture_errors({"a": AT}, title="", widest=math.nan)],
    "near must be": [
        lambda: plots.draw_distances({"a": AT}, title="", near=math.nan),
        lambda: plots.draw_distances({"a": AT}, title="", near=-1),
    ],
    "radius must be": [lambda: plots.draw_paths({"a": np.eye(3)}, (0, 0, 0), radius=math.nan, title="")],
    "goal must have shape": [lambda: plots.draw_reward_maps(REWARDS, goal=(1,), title="")],
    "goal must be": [
        lambda: plots.draw_reward_maps(REWARDS, goal=None, title=""),
        lambda: plots.draw_reward_maps(REWARDS, goal=(0.4, math.nan), title=""),
    ],
    "'area' must have 2 parts": [lambda: plots.draw_error_maps(ERRORS, title="", area=3)],
    "y of the area must be increasing": [
        lambda: plots.draw_reward_maps(REWARDS, goal=(0, 0), title="", area=((0, 1), (1, 0)))
    ],
    "limits must be positive and increasing": [lambda: plots.draw_error_maps(ERRORS, title="", limits=(0, 1))],
    "limits of 'p' must be increasing": [
        lambda: plots.draw_learning_curves(CURVES, title="", xlabel="", limits={"p": (1, 1)})
    ],
    "marks of 'p' must be a mapping": [lambda: plots.draw_learning_curves(CURVES, title="", xlabel="", marks={"p": 1})],
    "mark 'm' must have shape": [
        lambda: plots.draw_learning_curves(CURVES, title="", xlabel="", marks={"p": {"m": (1,)}})
    ],
    "n_steps must be": [lambda: plots.draw_discounted_rewards(AT, AT, gamma=0.9, n_steps=10**400, title="")],
    "height must be at least 1": [lambda: plots.side_camera(PENTAGON, width=9, height=0)],
    "expected a Pentagon": [lambda: plots.draw_pentagons({"a": None})],
    "colours must have one for 'a'": [
        lambda: plots.draw_success(AT, {"a": plots.Success(AT)}, colours={}),
        lambda: plots.draw_success(AT, {"a": plots.Success(AT)}, colours={"a": "no colour"}),
    ],
    "the method 'a' must be a Success": [lambda: plots.draw_success(AT, {"a": AT})],
    "distances that increase": [lambda: plots.draw_reward_sections(AT[::-1], {"a": AT}, title="")],
    "title has a formula that cannot be drawn": [lambda: plots.draw_distances({"a": AT}, title="$\\frac{$")],
    "note must be text": [lambda: plots.draw_distances({"a": AT}, title="", note=3)],
    "a name in episodes must be text": [lambda: plots.draw_distances({1: AT}, title="")],
}


@pytest.mark.parametrize("message", CASES)
def test_refused(message):
    for call in CASES[message]:
        with pytest.raises(InputError, match=message):
            call()


def test_limits_change_colours_but_no_numbers(texts):
    errors = np.array([1e-12, 3e-12, 5e-12, 2e-12, 2e-9])
    figure = plots.draw_error_maps({"a": (ERRORS["a"][0], errors)}, title="", limits=(1e-2, 1.0))
    assert "median 3e-12, max 2e-09" in texts(figure)
    assert np.asarray(figure.axes[0].collections[0].get_array()).tolist() == [0.01] * 5

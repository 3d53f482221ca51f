"""Figures under fuzz: data that cannot be drawn is refused, all other is drawn to the last pixel."""

import warnings
from inspect import signature
from io import BytesIO

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kinreach import plots
from tests.robustness.fuzzing import NUMBERS, bad_arrays, things

NAMES = st.sampled_from(["a", "lm", "$", "$\\frac{$", "\\$", "a$b$c", "<b>&", "%s{}", "x" * 80, "é", "line\nbreak"])


def drawn(figure):
    """A figure really is one only when its pixels are there."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "constrained_layout not applied|Glyph .* missing", UserWarning)
        figure.savefig(BytesIO(), dpi=30)


def line(n=5, low=-3.0, high=3.0):
    return arrays(np.float64, n, elements=st.floats(low, high)) | bad_arrays((n,))


def mapping(values):
    return st.dictionaries(NAMES, values, max_size=3)


GROWING = st.lists(st.floats(0, 1e6), min_size=1, max_size=6, unique=True).map(sorted).map(np.array)
RUNS = st.lists(
    st.tuples(GROWING, line()) | GROWING.map(lambda x: (x, np.sin(x))) | st.tuples(line(), line()), max_size=3
)
GRIDS = st.tuples(line(3), line(4), bad_arrays((3, 4)) | arrays(np.float64, (3, 4), elements=st.floats(-100, 20)))
POINTS = st.tuples(bad_arrays((5, 2)) | arrays(np.float64, (5, 2), elements=st.floats(-1, 1)), line(5, 1e-6, 10))
SHARES = st.builds(plots.Success, line(5, 0, 1), st.none() | bad_arrays((5, 2)) | arrays(np.float64, (5, 2)))
POSITIVE = st.floats(1e-6, 1e3)
PICTURES = (
    arrays(np.uint8, (5, 7, 3))
    | arrays(np.float32, (5, 7), elements=st.floats(0, 9, width=32))
    | arrays(np.bool_, (5, 7))
    | bad_arrays((5, 7))
    | bad_arrays((5, 7, 3))
)
DRAWINGS = {
    "learning_curves": (
        st.tuples(mapping(mapping(RUNS))), lambda panels: plots.draw_learning_curves(panels, title="t", xlabel="x"),
    ),
    "episode_rewards": (
        st.tuples(line(), st.none() | line(), st.integers(1, 3) | NUMBERS | things()),
        lambda rewards, at, window: plots.draw_episode_rewards(rewards, title="t", at=at, window=window),
    ),
    "distances": (st.tuples(mapping(line(5, 1e-6, 3))), lambda episodes: plots.draw_distances(episodes, title="t")),
    "discounted_rewards": (
        st.tuples(GROWING | line(), line(), st.floats(0, 1) | NUMBERS, st.integers(1, 9) | NUMBERS | things()),
        lambda x, y, gamma, n: plots.draw_discounted_rewards(x, y, gamma=gamma, n_steps=n, title="t"),
    ),
    "error_maps": (st.tuples(mapping(POINTS)), lambda maps: plots.draw_error_maps(maps, title="t")),
    "reward_maps": (
        st.tuples(mapping(GRIDS.map(lambda grid: plots.RewardMap(*grid)))),
        lambda maps: plots.draw_reward_maps(maps, goal=(0.4, 0.0), title="t"),
    ),
    "success": (st.tuples(line(5, 1e-3, 10), mapping(SHARES)), plots.draw_success),
    "posture_errors": (st.tuples(mapping(line(5, 0, 1))), lambda errors: plots.draw_posture_errors(errors, title="t")),
    "pictures": (st.tuples(mapping(PICTURES)), plots.draw_pictures),
    "camera_steps": (
        st.tuples(mapping(PICTURES), line(3, 0.5, 9)),
        lambda pictures, circle: plots.draw_camera_steps(pictures, circle, title="t"),
    ),
    "paths": (
        st.tuples(mapping(bad_arrays((4, 3)) | arrays(np.float64, (4, 3), elements=st.floats(-1, 1))), line(3)),
        lambda paths, target: plots.draw_paths(paths, target, radius=0.05, title="t"),
    ),
    "error_bands": (
        st.tuples(line(5, 1e-3, 10), mapping(bad_arrays((5, 3)) | arrays(np.float64, (5, 3), elements=POSITIVE))),
        lambda x, errors: plots.draw_error_bands(x, errors, title="t", xlabel="x"),
    ),
    "local_optimum": (
        st.tuples(*[GROWING | line(), mapping(line(3, -100, 20))] * 2),
        lambda *parts: plots.draw_local_optimum(*parts, title="t"),
    ),
    "reward_sections": (
        st.tuples(GROWING | line(3, 1e-3, 3), mapping(line(3, -100, 20))),
        lambda d, rewards: plots.draw_reward_sections(d, rewards, title="t"),
    ),
    "pentagon": (
        st.tuples(bad_arrays((6,)) | arrays(np.float64, 6, elements=st.floats(-3, 3)), st.floats(-1, 0) | NUMBERS),
        lambda q, ground: plots.draw_pentagons({"$": plots.pentagon_of(q, ground=ground)}),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", DRAWINGS)
def test_figures(name, fuzzed):
    cases, draw = DRAWINGS[name]
    fuzzed(cases, lambda case: drawn(draw(*case)), share=0.12, least=0.5)


AT, HOME = np.linspace(0.1, 0.9, 5), [-1.57, -1.57, 1.57, -1.57, -1.57, 0.0]
PENTAGON = plots.pentagon_of(HOME, ground=-0.2)
PICTURE, GREY = np.full((30, 40, 3), 99, np.uint8), np.linspace(0.0, 1.0, 1200).reshape(30, 40)
AREA = ((0.2, 0.4), (-0.1, 0.1))
#: Arguments of every function that draws, or makes what is drawn, all of them good.
GOOD = {
    "draw_camera_steps": {"pictures": {"a": PICTURE, "b": GREY}, "circle": (9.0, 9.0, 4.0), "marked": ["a"],
                          "title": "t", "units": {"b": "m"}, "zoom": 3.0, "note": "n"},
    "draw_clipped_objective": {"epsilon": 0.2},
    "draw_discounted_rewards": {"steps": AT, "returns": AT, "gamma": 0.9, "n_steps": 2, "title": "t", "note": "n"},
    "draw_distance_reward": {"farthest": 3.0},
    "draw_distances": {"episodes": {"a": AT}, "title": "t", "near": 0.2, "xlabel": "x", "note": "n"},
    "draw_episode_rewards": {"rewards": AT, "title": "t", "at": AT, "window": 2, "xlabel": "x", "note": "n"},
    "draw_error_bands": {"tolerances": AT, "errors": {"a": np.outer(AT, AT)}, "title": "t", "xlabel": "x",
                         "ylabel": "y", "limit": 0.5, "note": "n"},
    "draw_error_maps": {"maps": {"a": (np.column_stack([AT, AT]), AT)}, "title": "t", "label": "l",
                        "limits": (0.1, 1.0), "missing": "m", "area": AREA, "columns": 2, "note": "n"},
    "draw_learning_curves": {"panels": {"p": {"a": [(AT, AT)]}}, "title": "t", "xlabel": "x", "log": ["p"],
                             "limits": {"p": (0.1, 2.0)}, "marks": {"p": {"m": (0.5, 0.5)}}, "note": "n"},
    "draw_local_optimum": {"offsets": AT, "joints": {"j1": AT}, "heights": AT, "explored": {"0.1": AT}, "title": "t",
                           "note": "n"},
    "draw_paths": {"paths": {"a": np.eye(3)}, "target": (0.5, 0.5, 0.5), "radius": 0.05, "title": "t", "note": "n"},
    "draw_pentagon_angles": {"pentagon": PENTAGON, "title": "t"},
    "draw_pentagons": {"pentagons": {"a": PENTAGON}, "title": "t", "pictures": {"a": (PICTURE, (0.0, 1.0, 0.0, 1.0))},
                       "note": "n"},
    "draw_pictures": {"pictures": {"a": PICTURE, "b": GREY}, "title": "t", "columns": 2, "width": 9.0,
                      "units": {"b": "m"}, "note": "n"},
    "draw_posture_errors": {"errors": {"a": AT}, "title": "t", "widest": 0.4, "note": "n"},
    "draw_reward_maps": {"maps": {"a": plots.RewardMap(AT, AT, np.outer(AT, AT))}, "goal": (0.4, 0.0), "area": AREA,
                         "title": "t", "note": "n"},
    "draw_reward_sections": {"distances": AT, "rewards": {"a": AT}, "title": "t", "note": "n"},
    "draw_success": {"tolerances": AT, "methods": {"a": plots.Success(AT)}, "title": "t", "xlabel": "x",
                     "colours": {"a": "red"}, "note": "n"},
    "pentagon_of": {"q": HOME, "ground": -0.2, "kinematics": None},
    "side_camera": {"pentagon": PENTAGON, "width": 64, "height": 48},
}  # fmt: skip
ODD = NUMBERS | things() | st.integers(-2, 40) | bad_arrays((2,)) | bad_arrays((5,)) | NAMES | PICTURES
ODDITIES = ODD | st.dictionaries(st.sampled_from(["a", "b", "p", "j1"]) | NAMES, ODD, max_size=2) | st.tuples(ODD, ODD)


def variants(good):
    """Values of the same kind, most of them as good."""
    if isinstance(good, dict):
        return st.fixed_dictionaries({key: variants(value) for key, value in good.items()})
    if isinstance(good, tuple | list):
        make = getattr(type(good), "_make", type(good))
        return st.tuples(*map(variants, good)).map(make)
    if isinstance(good, float) or (isinstance(good, np.ndarray) and good.dtype.kind == "f"):
        return st.floats(0.5, 2.0).map(lambda factor: factor * good)
    if isinstance(good, int):
        return st.integers(1, 9)
    return NAMES if isinstance(good, str) else st.just(good)


def test_every_function_and_argument_is_here():
    drawing = {name for name in plots.__all__ if name.startswith("draw_")}
    assert set(GOOD) == drawing | {"pentagon_of", "side_camera"}
    for name, arguments in GOOD.items():
        assert list(arguments) == list(signature(getattr(plots, name)).parameters), name


@pytest.mark.parametrize("name", GOOD)
def test_one_odd_argument(name, fuzzed):
    """Or one good one that is another: all others are good, so that a refusal is of this one."""
    draw = getattr(plots, name)

    def run(case):
        result = draw(**{**GOOD[name], **case})
        if name.startswith("draw_"):
            drawn(result)

    run({})
    keys = st.tuples(st.sampled_from(sorted(GOOD[name])), st.booleans())
    cases = keys.flatmap(
        lambda pair: st.fixed_dictionaries({pair[0]: ODDITIES if pair[1] else variants(GOOD[name][pair[0]])})
    )
    fuzzed(cases, run, share=0.4)


def test_series(fuzzed):
    def run(case):
        which, values, flags, number = case
        if which == "mean":
            assert plots.moving_mean(values, number).shape == np.shape(values)
        elif which == "block":
            ends, counts = plots.per_block(values, number)
            assert ends.shape == counts.shape
        elif which == "returns":
            assert plots.discounted_returns(values, flags, number).shape == np.shape(values)
        else:
            band = plots.seed_band(values)
            assert (band.low <= band.median).all()
            assert (band.median <= band.high).all()

    number = st.integers(1, 4) | NUMBERS | things() | st.floats(0, 1)
    flags = arrays(np.bool_, 5) | line()
    series = st.tuples(st.sampled_from(["mean", "block", "returns"]), line(), flags, number)
    fuzzed(series | st.tuples(st.just("band"), RUNS | things(), flags, number), run)

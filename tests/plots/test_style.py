"""The style of the figures: colours can be told apart, names are legible and stand beside their data."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from kinreach.compare import get_task
from kinreach.compare._methods.resolve import colours as task_colours
from kinreach.compare._task import task_names
from kinreach.plots import FAINT, INK, PALETTE, colours_of, draw_error_maps, label_ends, new_figure
from kinreach.plots._colours import OTHERS, RULES, own_colour
from kinreach.plots._style import GRID, LEADER, plain, spread
from kinreach.plots.inside import method_colours, text_colour
from tests.cases import slow

#: What colours look like to people without red, green or blue cones (Machado, Oliveira, Fernandes 2009, severity 1).
BLINDNESS = {
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(colour: str) -> np.ndarray:
    c = np.array(to_rgb(colour))
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIELAB of linear sRGB."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(rgb, 0, 1) / (to_xyz @ np.ones(3))
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_colours_differ_for_everybody():
    """A difference of 2.3 can just be seen; the first six colours, which most figures need at most, keep 8 of it."""
    pairs = 0
    for matrix in (np.eye(3), *map(np.array, BLINDNESS.values())):
        seen = [lab(matrix @ linear(colour)) for colour in PALETTE]
        for i, j in combinations(range(len(PALETTE)), 2):
            assert np.linalg.norm(seen[i] - seen[j]) > (8.0 if max(i, j) < 6 else 5.0), (PALETTE[i], PALETTE[j])
            pairs += 1
    assert pairs == 4 * 28


def test_ink_can_be_read():
    """Contrast on white of at least 4.5 for text (WCAG 2), and hardly any for the grid."""

    def contrast(colour: str) -> float:
        return 1.05 / (float(linear(colour) @ [0.2126, 0.7152, 0.0722]) + 0.05)

    assert contrast(INK) > contrast(FAINT) > 4.5
    assert contrast(GRID) < 1.5


def test_spread_keeps_order_and_gap():
    cases = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        positions = list(rng.uniform(0, 1, int(rng.integers(1, 9))))
        placed = np.array(spread(positions, gap=0.06))
        assert (np.argsort(placed) == np.argsort(positions)).all()
        assert (np.diff(np.sort(placed)) >= 0.06 - 1e-12).all()
        assert placed.min() >= 0
        cases += 1
    assert cases == 200
    assert spread([0.2, 0.9], gap=0.06) == pytest.approx([0.2, 0.9])  # what does not collide stays
    assert spread([0.9, 0.02, 0.01, 0.0], gap=0.06) == pytest.approx([0.9, 0.12, 0.06, 0.0])  # nor what is far above
    assert spread([], gap=0.06) == []


@pytest.mark.parametrize("side", ["left", "right"])
def test_names_beside_lines_do_not_overlap(side):
    cases = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        figure, (ax,) = new_figure("title", size=(7, 4))
        at = {"left": 0.0, "right": 1.0}[side] if seed % 2 else 0.5
        ends = {f"method {i}": (at, y) for i, y in enumerate(rng.uniform(0.4, 0.6, 6))}
        label_ends(ax, ends, colours_of(ends), side=side)
        figure.canvas.draw()
        boxes = sorted((text.get_window_extent() for text in ax.texts), key=lambda box: box.y0)
        assert len(boxes) == 6
        assert all(below.y1 <= above.y0 + 1.0 for below, above in pairwise(boxes))  # half a pixel at both is rounding
        cases += 1
    assert cases == 10


@pytest.mark.parametrize("side", [*slow("left"), "right"])
def test_a_stroke_to_a_name_is_no_line_that_goes_on(side):
    """It is beside the axes, of no method's colour, and slanted; a name that was hardly moved has none."""
    strokes = names = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        figure, (ax,) = new_figure("title", size=(9, 3.8))
        x, y = rng.uniform(0, 1, 8), rng.uniform(0.4, 0.6, 8)
        x[:3] = side == "right"
        ends = {f"method {i}": place for i, place in enumerate(zip(x, y, strict=True))}
        label_ends(ax, ends, colours_of(ends), side=side)
        figure.draw_without_rendering()
        names += len(ax.texts)
        for line in ax.lines:
            places, heights = line.get_xdata(), line.get_ydata()
            assert min(places) > 1.0 if side == "right" else max(places) < 0.0
            assert abs(heights[1] - heights[0]) > 0.02
            assert line.get_color() == LEADER
            strokes += 1
    assert names == 80
    assert 10 <= strokes < 80


def test_a_line_that_ends_early_is_named_there():
    figure, (ax,) = new_figure("title", size=(9, 3.8))
    label_ends(ax, {"early": (0.3, 0.6), "late": (1.0, 0.6)}, colours_of(["early", "late"]))
    figure.draw_without_rendering()
    boxes = {t.get_text(): ax.transAxes.inverted().transform(t.get_window_extent().get_points()) for t in ax.texts}
    early, late = boxes["early"], boxes["late"]
    assert 0.3 < early[0, 0] < 0.35
    assert early[0, 1] < 0.6 < early[1, 1]
    assert late[0, 0] > 1.0


def test_a_method_has_one_colour_everywhere():
    """In figures of trainings, and in every comparison."""
    names = ["thesis-ppo-single", "seed 1", "ranked-single", "ppo, target 1", "ppo", "seed 2"]
    colours = colours_of(names)
    assert colours["ranked-single"] == colours_of(["sac-single", "ranked-single"])["ranked-single"]
    assert colours["ppo, target 1"] == colours["ppo"]
    assert len(set(colours.values())) == 5
    compared = {}
    for task in task_names():
        for name, colour in task_colours(get_task(task).methods).items():
            assert compared.setdefault(name, colour) == colour == colours_of([name])[name]
            assert colour == own_colour(name)
        assert len(set(task_colours(get_task(task).methods).values())) == len(get_task(task).methods), task
    assert len(compared) >= 25
    assert compared["ranked-single"] == colours["ranked-single"]
    for shown in FIGURES:
        assert len(set(colours_of(shown).values())) == len(shown), shown


#: Names without a star in the rules.
KNOWN = [name for patterns in RULES.values() for name in patterns if "*" not in name]


def test_unknown_methods_have_stable_colours_that_no_known_one_has():
    assert not set(OTHERS) & set(RULES)
    alone = [method_colours([f"mine-{number}"])[f"mine-{number}"] for number in range(40)]
    assert set(alone) == set(OTHERS)
    cases = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        names = [f"mine-{i}" for i in rng.permutation(40)[: len(OTHERS)]]
        names += [str(name) for name in rng.permutation(KNOWN)[:4]]
        colours = method_colours(names)
        assert colours[names[0]] == method_colours([names[0], *KNOWN])[names[0]]
        assert len(set(colours.values())) == len(colours)
        cases += 1
    assert cases == 30
    for pair in (["policy", "ranked-single"], ["ranked-single", "policy"]):  # a file's name may be a method's
        colours = method_colours(pair)
        assert colours["ranked-single"] == own_colour("ranked-single") != colours["policy"]


def test_names_can_be_read():
    """Contrast on white of at least 4.5 for names in the colour of their line (WCAG 2)."""
    shades = [text_colour(colour) for colour in {*RULES, *OTHERS, *PALETTE}]
    assert len(shades) >= 18
    for shade in shades:
        assert 1.05 / (float(linear(shade) @ [0.2126, 0.7152, 0.0722]) + 0.05) > 4.4


def test_maps_are_filled_and_have_units():
    """A grid's cells are its positions; other goals colour what is nearest to them, and what is missing is grey."""
    x, y = np.meshgrid(np.linspace(0.3, 0.6, 4), np.linspace(-0.2, 0.2, 6), indexing="ij")
    errors = np.random.default_rng(0).uniform(1.0, 9.0, 24)
    errors[3] = np.nan
    scattered = np.random.default_rng(1).uniform((0.3, -0.3), (0.65, 0.3), (150, 2))
    figure = draw_error_maps(
        {"grid": (np.column_stack([x.ravel(), y.ravel()]), errors), "goals": (scattered, np.full(150, 2.0))},
        title="Errors", label="error [mm]",
    )  # fmt: skip
    grid, goals, bar = figure.axes
    cells, filled = (
        np.ma.filled(np.ma.asarray(ax.collections[1].get_array(), dtype=float), np.nan) for ax in (grid, goals)
    )
    np.testing.assert_array_equal(cells.reshape(4, 6), errors.reshape(4, 6))
    assert np.isfinite(filled).mean() > 0.97
    assert (grid.get_xlabel(), grid.get_ylabel(), bar.get_ylabel()) == ("y [m]", "x [m]", "error [mm]")


#: Methods that a figure of a notebook shows beside each other.
FIGURES = [
    ["thesis-ppo-single", "sb3-single"],
    ["ppo-single", "ranked-single"],
    ["ranked-single", "ppo-single", "thesis-ppo-single"],
    ["sac-single", "td3-single", "ddpg-single", "thesis-ppo-single"],
    ["sac-multi", "td3-multi", "ddpg-multi", "thesis-ppo-multi"],
    ["thesis-ppo-multi", "sb3-multi"],
    ["ppo-multi", "ppo-multi-ending"],
    ["closed-form", "ranked-single", "ppo-single", "ranked-multi"],
    ["button", "button-report", "button-dqn"],
    [f"button-{name}" for name in ("report-actuation", "report-both", "report-controls", "report-frames",
     "guided-controls", "dqn-report-actuation")],
    ["analytic", "ppo", "random"],
    [f"seed {seed}" for seed in range(5)],
]  # fmt: skip


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (1, "1"), (0.5, "0.5"), (0.001, "0.001"), (1e-13, "$10^{-13}$"), (5e-4, "0.0005"), (1e4, "$10^{4}$"),
     (2500, "2500"), (-3, "-3")],
)  # fmt: skip
def test_plain_numbers(value, text):
    assert plain(value) == text


def test_every_colour_is_one():
    assert all(to_rgb(colour) for colour in RULES)
    assert len(RULES) >= 15

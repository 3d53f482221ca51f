"""Figures of comparisons: the parts of a distance as dots, flat lines as sentences, maps."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from kinreach.compare._curves import draw_looks, draw_pressed
from kinreach.compare._figures import SMALLEST_PART_MM, draw_budget, draw_map, draw_strip_grid

SETTINGS = {"goals": 40, "seed": 0, "command": "again"}


def test_parts_of_a_distance_are_dots_in_millimetres(texts):
    budget = {"seeing": 0.13, "deciding": -0.004, "moving": 2e-9, "distance": 0.126000002}
    methods = [
        {"name": "a", "colour": "#0072B2", "budget_mm": budget, "budget_mm_ci": {"seeing": [0.12, 0.14]}},
        {"name": "b", "colour": "#D55E00", "budget_mm": dict.fromkeys(budget)},
    ]
    figure = draw_budget(("seeing", "deciding", "moving"), "meaning")([], {"methods": methods, "settings": SETTINGS})
    (axes,) = figure.axes
    dots = [line for line in axes.lines if line.get_marker() in "osD" and len(line.get_xdata()) == 1]
    assert [float(dot.get_xdata()[0]) for dot in dots] == pytest.approx([0.13, 0.004, SMALLEST_PART_MM])
    assert [to_rgb(dot.get_markerfacecolor()) == (1.0, 1.0, 1.0) for dot in dots] == [False, True, False]
    assert axes.get_xscale() == "log"
    assert [0.12, 0.14] in [[*line.get_xdata()] for line in axes.lines]  # the interval
    assert {"0.13 − 0.0040 + 2e-9 = 0.13 mm", "none"} <= set(texts(figure))


def test_a_method_that_looks_do_not_change_is_a_sentence(texts):
    rng = np.random.default_rng(0)
    errors = {"flat": lambda looks: 5.0, "steep": lambda looks: 5.0 / (1 + looks)}
    errors["as steep"] = errors["steep"]
    cases = [(0, 0), (0, 1), (5, 0), (5, 1)]
    trials = [
        {"method": name, "goal_index": i, **{f"error_{b}_{a}": mm(b) * rng.uniform(1, 1.0001) for b, a in cases}}
        for name, mm in errors.items()
        for i in range(9)
    ]  # fmt: skip
    methods = [{"name": name, "colour": "#0072B2"} for name in errors]
    draw = draw_looks((0, 5), lambda budget, again: lambda trial: trial[f"error_{budget}_{again}"])
    figure = draw(trials, {"methods": methods, "settings": SETTINGS})
    first, second = figure.axes
    steep, as_steep = (line.get_xdata() for line in first.lines if line.get_marker() == "o")
    assert as_steep - steep == pytest.approx([0.09, 0.09])  # side by side
    assert (steep + as_steep) / 2 == pytest.approx([0, 1])
    assert "looks change nothing for flat (5.00 mm)" in first.get_title(loc="left")
    assert "steep" in [text.get_text() for text in first.texts]
    dots = [float(line.get_xdata()[0]) for line in second.lines if line.get_marker() == "o"]
    assert dots == pytest.approx([5.0, 5.0, *2 * [5.0, 5.0 / 6]], rel=1e-3)  # a row a method: no looks before, and five
    assert [tick.get_text() for tick in second.get_yticklabels()] == ["flat", "steep", "as steep"]
    assert "open: 0 looks before · filled: 5" in second.get_title(loc="left")


def test_strips_have_their_labels_and_what_is_in_them_in_numbers(texts):
    rng, names = np.random.default_rng(0), ("a", "b", "never")
    trials = [
        {"method": name, "far": rng.uniform(1.0, 90.0), "count": int(rng.integers(0, 9))}
        for name in names[:2]
        for _ in range(30)
    ]
    strips = {"far [mm]": (lambda trial: trial["far"], False), "presses": (lambda trial: trial["count"], True)}
    methods = [{"name": name, "colour": "#0072B2"} for name in names]
    draw = draw_strip_grid("Episodes", strips, marks={"far [mm]": 50.0}, legend="dot: one goal")
    figure = draw(trials, {"methods": methods, "settings": SETTINGS})
    said = texts(figure)
    assert [(axes.get_xlabel(), axes.get_xscale()) for axes in figure.axes] == [
        *zip(strips, ("log", "symlog"), strict=True)
    ]
    for (label, (value, _)), axes in zip(strips.items(), figure.axes, strict=True):
        assert [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == "--"] == [50.0] * (
            label == "far [mm]"
        )
        for row, name in enumerate(names[:2]):
            own = [value(trial) for trial in trials if trial["method"] == name]
            (dots,) = (part for part in axes.collections if abs(part.get_offsets()[0, 1] - row) < 0.3)
            np.testing.assert_array_equal(dots.get_offsets()[:, 0], own)
            assert any(f"median {np.median(own):.3g} ·" in text for text in said)
    assert said.count("none") == len(strips)


@pytest.mark.slow
def test_a_map_has_a_panel_a_method_and_crosses_where_it_failed(texts):
    rng = np.random.default_rng(0)
    goals = rng.uniform((0.3, -0.3, 0), (0.65, 0.3, 0), (40, 3))
    trials = [
        {"method": name, "goal_index": i, "goal": goal.tolist(), "distance": 1e-3, "reached": i % 4 > 0 or name == "a"}
        for name in ("a", "b", "never")
        for i, goal in enumerate(goals)
    ]
    for trial in trials:
        trial["reached"] &= trial["method"] != "never"
    methods = [{"name": name, "colour": "#0072B2"} for name in ("a", "b", "never")]
    figure = draw_map(trials, {"methods": methods, "settings": SETTINGS})
    said = texts(figure)
    assert {
        "a",
        "b",
        "never",
        "median 1, max 1",
        "median 1, max 1 · 10 not reached (×)",
        "none · 40 not reached (×)",
    } <= set(said)
    assert "distance of the tip [mm]" in said


def test_a_curve_of_presses_ends_at_the_share_that_was_reached(texts):
    """It rises by one goal at each press; its dot has the share and the interval of the results."""
    rng, dots, none = np.random.default_rng(1), 0, 0
    for _ in range(4):
        trials, methods = [], []
        for name, chance in (("often", 0.8), ("seldom", 0.3), ("never", 0.0)):
            own = [
                {"method": name, "goal_index": i, "steps": int(rng.integers(1, 50)), "reached": rng.random() < chance}
                for i in range(20)
            ]
            share = sum(trial["reached"] for trial in own) / 20
            interval = [0.9 * share, 1.0 - 0.8 * (1.0 - share)]
            methods.append({"name": name, "colour": "#0072B2", "goals": 20, "reached": share, "reached_ci": interval})
            trials += own
        figure = draw_pressed(trials, {"methods": methods, "settings": SETTINGS})
        (axes,) = figure.axes
        seen = [method for method in methods if method["reached"]]
        steps = [line for line in axes.lines if line.get_drawstyle() == "steps-post"]
        ends = [bar for bar in axes.containers if bar.has_yerr]
        last = max(trial["steps"] for trial in trials)
        for method, line, bar in zip(seen, steps, ends, strict=True):
            dot, _, (interval,) = bar.lines
            assert dot.get_ydata()[0] == pytest.approx(100 * method["reached"])
            assert interval.get_segments()[0][:, 1] == pytest.approx(100 * np.array(method["reached_ci"]))
            assert dot.get_xdata()[0] > last
            pressed = sorted(t["steps"] for t in trials if t["method"] == method["name"] and t["reached"])
            assert line.get_xdata().tolist() == [0, *pressed, last]
            assert np.diff(line.get_ydata()[:-1]) == pytest.approx(5.0)
            assert line.get_ydata()[-1] == pytest.approx(100 * method["reached"])
            dots += 1
        assert any("none of 40 goals: never" in text for text in texts(figure))
        none += 1
    assert (dots, none) == (8, 4)

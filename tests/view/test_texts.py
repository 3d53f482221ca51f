"""Numbers and colours of the page's texts, at the bounds where they change."""

import numpy as np
import pytest

from kinreach.view import _html as html
from kinreach.view._names import angle, branch_name, length, plain

LENGTHS = {
    0.0: "0 mm", 9.99e-7: "< 1 µm", 1e-6: "1 µm", 9.4e-6: "9 µm", 1e-5: "0.01 mm", 9.94e-4: "0.99 mm", 1e-3: "1.0 mm",
    9.94e-3: "9.9 mm", 0.01: "10 mm", 1.2344: "1234 mm",
}  # fmt: skip


@pytest.mark.parametrize(("value", "said"), LENGTHS.items())
def test_lengths_have_about_two_digits(value, said):
    assert length(value) == said


def test_angles_are_in_whole_degrees_unless_digits_are_asked_for():
    assert (angle(1.0), angle(-np.pi / 2), angle(1.0, 1), angle(1.0, 2)) == ("57°", "-90°", "57.3°", "57.30°")


def test_names_lose_their_suffix_only():
    names = {"wrist_1_joint": "wrist 1", "upper_arm_link": "upper arm", "link_1": "link 1", "joint": "joint"}
    assert {name: plain(name) for name in names} == names
    assert branch_name(None, 0) == "posture 1"


def test_a_message_is_red_before_it_is_orange():
    colours = {(False, False): "", (False, True): " kr-caution", (True, False): " kr-wrong", (True, True): " kr-wrong"}
    for (bad, caution), colour in colours.items():
        assert f'class="kinreach-verdict{colour}">a &lt; b</div>' in html.message("a < b", bad=bad, caution=caution)
    assert html.message("a") == html.message("a", bad=False, caution=False)


#: Speed of the slowest direction [m/rad] -> colour, width [%], speed of the joints.
GAUGES = {
    0.0: (html._RED, 0, "no finite speed"),
    1e-6: (html._RED, 0, "no finite speed"),
    2e-6: (html._RED, 0, "50000.0 rad/s"),
    0.0149: (html._RED, 12, "6.7 rad/s"),
    0.015: (html._ORANGE, 12, "6.7 rad/s"),
    0.0399: (html._ORANGE, 33, "2.5 rad/s"),
    0.04: (html._GREEN, 33, "2.5 rad/s"),
    0.12: (html._GREEN, 100, "0.8 rad/s"),
    0.5: (html._GREEN, 100, "0.2 rad/s"),
}


@pytest.mark.parametrize(("stiffness", "shown"), GAUGES.items())
def test_a_gauge_changes_its_colour_at_its_bounds(stiffness, shown):
    colour, width, speed = shown
    text = html.gauge(stiffness, "wrist <straight>")
    assert f"width:{width}%;background:{colour}" in text
    assert f"100 mm/s need {speed}. Nearest singularity: wrist &lt;straight&gt;." in text
    assert "Nearest" not in html.gauge(stiffness, "")


@pytest.mark.parametrize(
    ("most", "top", "limit"),
    [(0.0, 10, ""), (0.1, 10, ""), (0.11, 20, ""), (0.4, 40, ""), (0.41, 60, ""), (0.8, 80, ""), (0.81, 100, "100.0"),
     (1.0, 100, "100.0"), (1.01, 110, "90.9"), (1.55, 160, "62.5")],
)  # fmt: skip
def test_a_chart_is_as_high_as_its_largest_speed(most, top, limit):
    """With the line of the limit where it is in sight; a line has corners where it bends only."""
    times = np.array([0.0, 0.5, 1.0, 2.0])
    shares = np.column_stack([most * np.array([0.0, 0.5, 1.0, 0.0]), np.zeros(4)])
    text = html.chart(times, shares)
    percents = [f"<span>{value:g} %</span>" for value in (top, top / 2, 0)]
    assert "".join(percents) in text
    assert (f'class="kr-limit" x1="0" x2="1000" y1="{limit}"' if limit else "kr-level") in text
    assert ("kr-limit" in text) == bool(limit)
    heights = 100 * shares[:, 0] / (top / 100)
    corners = [f"{1000 * t / 2:.1f},{height:.2f}" for t, height in zip(times, heights, strict=True)]
    assert f'points="{" ".join([corners[0], *([corners[2]] if most else []), corners[3]])}"' in text
    assert 'points="0.0,0.00 1000.0,0.00"' in text
    assert "<span>2.00 s</span>" in text

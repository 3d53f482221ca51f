"""The picture of a calibration: which share of rows and of postures is within which distance."""

from types import SimpleNamespace

import numpy as np
import pytest

from kinreach.errors import InputError
from kinreach.plots import draw_calibration
from kinreach.robots import get_arm


def test_shares_of_rows_and_postures_rise_to_all_at_the_largest_distance(texts):
    rng, drawn = np.random.default_rng(0), 0
    parts = {"before": 20, "held_out": 20, "correction": 90, "expected": 90}
    fit = SimpleNamespace(rows=20, dropped=(("line 3", "far off"),))
    for name, count in parts.items():
        setattr(fit, name, 10.0 ** rng.uniform(-6, -2, count))
    figure = draw_calibration(SimpleNamespace(fit=fit, models=("ur5e", "ur7e"), arm=get_arm("ur5e")))
    lines = [line for axes in figure.axes for line in axes.lines]
    for (name, count), line in zip(parts.items(), lines, strict=True):
        distances, shares = line.get_data()
        np.testing.assert_allclose(distances, 1e3 * np.sort(getattr(fit, name)))
        np.testing.assert_allclose(shares, np.linspace(100.0 / count, 100.0, count))
        drawn += count
    said = texts(figure)
    assert "Calibration of a ur5e or ur7e" in said
    assert "Left: 20 rows, 1 dropped. Right: 90 random postures." in said
    assert [axes.get_xscale() for axes in figure.axes] == ["log", "log"]
    assert drawn == 220


def test_figures_that_were_read_have_no_errors():
    with pytest.raises(InputError, match="no errors to draw"):
        draw_calibration(SimpleNamespace(fit=None))

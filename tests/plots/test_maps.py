"""Maps of errors: which way they lie, what their numbers and their scale are, where panels stand."""

import numpy as np
import pytest

from kinreach.plots._maps import draw_error_maps, outline, view_from_the_robot
from kinreach.plots._style import new_figure

GRID = np.array([(x, y) for x in (0.2, 0.3, 0.4) for y in (-0.2, 0.0, 0.2)])
ERRORS = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, np.nan])


def panels(count):
    return {f"panel {number}": (GRID, ERRORS) for number in range(count)}


@pytest.mark.parametrize(
    ("count", "options", "shape", "width"),
    [(1, {}, (1, 1), 5.1), (3, {}, (2, 2), 9.4), (3, {"columns": 3}, (1, 3), 11.0), (2, {"columns": 3}, (1, 2), 9.4)],
)
def test_panels_stand_two_beside_each_other(count, options, shape, width):
    figure = draw_error_maps(panels(count), title="t", **options)
    *axes, bar = figure.axes
    assert axes[0].get_subplotspec().get_gridspec().get_geometry() == shape
    assert len(axes) == shape[0] * shape[1]
    assert [ax.axison for ax in axes] == [number < count for number in range(len(axes))]
    assert figure.get_size_inches()[0] == pytest.approx(width)
    assert bar.get_ylabel() == "error [mm]"


@pytest.mark.parametrize(("missing", "options"), [("not found", {}), ("no posture", {"missing": "no posture"})])
def test_numbers_above_a_panel(missing, options):
    figure = draw_error_maps({"a": (GRID, ERRORS), "b": (GRID, np.full(9, np.nan))}, title="t", **options)
    said = [[text.get_text() for text in ax.texts] for ax in figure.axes[:2]]
    assert said == [[f"median 4.5, max 8 · 1 {missing} (×)"], [f"none · 9 {missing} (×)"]]
    whole = draw_error_maps({"a": (GRID, np.arange(1.0, 10.0))}, title="t")
    assert [text.get_text() for text in whole.axes[0].texts] == ["median 5, max 9"]
    crosses = figure.axes[0].collections[-1].get_offsets()
    np.testing.assert_allclose(crosses, [GRID[-1, ::-1]])


@pytest.mark.parametrize(
    ("errors", "limits", "scale", "extend"),
    [(ERRORS, None, (1.0, 8.0), "neither"), (ERRORS, (0.5, 4.0), (0.5, 4.0), "both"),
     (np.full(9, 2.0), None, (2.0, 2.02), "neither"), (np.zeros(9), None, (1.0, 10.0), "neither"),
     (np.full(9, np.nan), None, (1.0, 10.0), "neither")],
)  # fmt: skip
def test_the_scale_is_that_of_the_errors_or_what_is_asked_for(errors, limits, scale, extend):
    figure = draw_error_maps({"a": (GRID, errors)}, title="t", limits=limits)
    mesh = figure.axes[0].collections[1]
    assert (mesh.norm.vmin, mesh.norm.vmax) == pytest.approx(scale)
    assert mesh.colorbar.extend == extend


def test_a_cell_has_its_error_and_none_has_that_of_its_neighbour():
    """Errors below the scale have the colour of its end; what is missing is grey."""
    figure = draw_error_maps({"a": (GRID, ERRORS)}, title="t", limits=(2.0, 9.0))
    grey, mesh = figure.axes[0].collections[:2]
    np.testing.assert_allclose(mesh.get_array(), np.array([2, 2, 3, 4, 5, 6, 7, 8, np.nan]).reshape(3, 3))
    np.testing.assert_array_equal(np.isnan(grey.get_array().filled(np.nan)).ravel(), [True] * 8 + [False])


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_the_robot_is_at_the_lower_edge(margin):
    """World x is up and y to the left."""
    _, (axes,) = new_figure("t", size=(2, 2))
    view_from_the_robot(axes, GRID[:, 0], GRID[:, 1], **({"margin": margin} if margin else {}))
    assert axes.get_xlim() == pytest.approx((0.2 + margin, -0.2 - margin))
    assert axes.get_ylim() == pytest.approx((0.2 - margin, 0.4 + margin))
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("y [m]", "x [m]")


def test_an_area_is_outlined_with_a_halo_if_asked():
    for halo, styles in (({}, ["--"]), ({"halo": False}, ["--"]), ({"halo": True}, ["-", "--"])):
        _, (axes,) = new_figure("t", size=(2, 2))
        outline(axes, ((0.2, 0.5), (-0.1, 0.3)), colour="#222222", **halo)
        assert [patch.get_linestyle() for patch in axes.patches] == styles
        for patch in axes.patches:
            assert patch.get_xy() == (-0.1, 0.2)
            assert (patch.get_width(), patch.get_height()) == pytest.approx((0.4, 0.3))
            assert not patch.get_fill()

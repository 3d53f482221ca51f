"""Figures are drawn as they are kept in tests/data/figures.txt: lines, cells and words, with place and colour."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.spines import Spine
from matplotlib.text import Text
from matplotlib.ticker import ScalarFormatter

from kinreach.deploy._move_cli import draw_motion
from kinreach.kinematics import Trajectory, URKinematics
from kinreach.plots import draw_error_maps, key, label_ends, new_figure
from kinreach.plots.inside import draw_workspace
from tests import kept

#: Kind of artist -> what is kept of it.
KEPT = {
    Text: ("text", "position", "color", "fontsize", "fontweight", "ha", "va"),
    Line2D: ("data", "color", "linewidth", "linestyle", "marker", "markersize", "solid_capstyle"),
    Collection: ("offsets", "array", "clim", "facecolor", "linewidth", "sizes", "coordinates"),
    Rectangle: ("bbox", "facecolor", "edgecolor", "linewidth", "linestyle", "fill"),
    Spine: ("edgecolor",),
    Axes: ("xlim", "ylim", "aspect", "facecolor", "xlabel", "ylabel", "axisbelow"),
}
#: What most artists have.
USUAL = {
    "visible": True,
    "clip_on": True,
    "alpha": None,
    "rasterized": False,
    "annotation_clip": None,
    "position": (0, 0),
}


def state(figure):
    """What is drawn in a figure, in order, with properties that matplotlib does not give to everything."""
    artists = [figure._suptitle, figure._supxlabel]
    for axes in figure.axes:
        spines = [spine for spine in axes.spines.values() if spine.get_visible()]
        grids = [*axes.get_xgridlines()[:1], *axes.get_ygridlines()[:1]]
        artists += [axes, *axes.lines, *axes.collections, *axes.texts, axes._left_title, *spines, *grids]
        artists += [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    found = {"figure": {"size": kept.written(figure.get_size_inches()), "dpi": str(figure.dpi)}}
    for artist in artists:
        if artist is None or not artist.get_visible() or (isinstance(artist, Text) and not artist.get_text()):
            continue
        kind = next(kind for kind in KEPT if isinstance(artist, kind))
        properties = {name: getattr(artist, f"get_{name}", lambda: None)() for name in (*KEPT[kind], *USUAL)}
        properties |= {"zorder": artist.get_zorder(), "effects": len(artist.get_path_effects() or ())}
        if kind is Axes:
            scaled = not isinstance(artist.yaxis.get_major_formatter(), ScalarFormatter)
            ticks = artist.yaxis.get_major_formatter().format_ticks(artist.yaxis.get_ticklocs()) if scaled else None
            grid = artist.get_gridspec()
            properties |= {
                "on": artist.axison,
                "ticks": ticks,
                "widths": None if grid is None else grid.get_width_ratios(),
            }
            properties |= {"title": artist.titleOffsetTrans.get_matrix()[1, 2], **artist.yaxis.get_tick_params()}
        if hasattr(artist, "xycoords"):
            properties |= {"xy": artist.xy, "in": str(artist.xycoords)}
        if properties.get("array") is not None:
            properties |= {"cmap": artist.cmap.name, "norm": type(artist.norm).__name__}
            properties["array"] = np.ma.filled(np.ma.asarray(artist.get_array(), dtype=float), np.nan)
        if kind is Rectangle:
            properties["bbox"] = artist.get_bbox().bounds
        if kind in (Axes, Spine):
            del properties["position"]
        number = sum(kind.__name__ in name for name in found)
        found[f"{number} {kind.__name__}"] = {
            name: kept.written(value) for name, value in properties.items() if not _is(value, USUAL.get(name))
        }
    return found


def _is(value, usual):
    return value is None or (usual is not None and np.array_equal(value, usual))


def maps():
    """A grid with a cell that is missing, and goals that are not."""
    x, y = np.meshgrid(np.linspace(0.3, 0.6, 4), np.linspace(-0.2, 0.2, 6), indexing="ij")
    rng = np.random.default_rng(0)
    errors = rng.uniform(1.0, 9.0, 24)
    errors[3] = np.nan
    goals = rng.uniform((0.3, -0.3), (0.65, 0.3), (60, 2))
    return {
        "grid": (np.column_stack([x.ravel(), y.ravel()]), errors),
        "goals $": (goals, rng.uniform(0.01, 200.0, 60)),
        "none": (goals[:5], np.full(5, np.nan)),
    }


def named():
    figure, axes = new_figure(
        "A figure", size=(8.0, 5.0), rows=2, columns=2, widths=[2, 1], note="small print " * 20, grid="y"
    )
    ends = {
        "first": (1.0, 0.5),
        "second": (1.0, 0.52),
        "third": (0.4, 0.9),
        f"a name that is {'too ' * 9}long": (1.0, 0.2),
    }
    colours = dict(zip(ends, ("#E69F00", "#0072B2", "#000000", "#8CCBEB"), strict=True))
    label_ends(axes[0], ends, colours)
    label_ends(axes[1], {name: (1.0 - x, y) for name, (x, y) in ends.items()}, colours, side="left")
    key(axes[2], "dots: medians")
    return figure


def moving():
    t = np.linspace(0.0, 2.0, 5)
    q = np.outer(t**2, [-0.5, 0.1, 0.7])
    return draw_motion(
        Trajectory(["a_joint", "b", "c"], t, q, np.gradient(q, t, axis=0)), np.full(3, 4.0), "a $ motion"
    )


def test_figures_are_as_they_were():
    area, kin = ((0.35, 0.55), (-0.2, 0.2)), URKinematics("ur5e")
    figures = {
        "maps": draw_error_maps(maps(), title="Errors", limits=(0.1, 100.0), area=area, note="of a test"),
        "maps with a scale of their own": draw_error_maps(
            dict(list(maps().items())[:1]), title="Errors", label="[mm]", missing="not seen", columns=3
        ),
        "maps without errors": draw_error_maps({"none": maps()["none"]}, title=""),
        "three columns": draw_error_maps(maps(), title="Errors", columns=3),
        "names": named(),
        "bare": new_figure("", size=(4.0, 3.0), bare=True, grid="none")[0],
        "motion": moving(),
        "agility": draw_workspace(kin, seed=3),
        "calibration": draw_workspace(kin, URKinematics("ur5"), seed=3),
    }
    things = {f"{name}: {thing}": each for name, figure in figures.items() for thing, each in state(figure).items()}
    kept.check("figures.txt", {"figures": things})

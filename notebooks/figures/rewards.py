"""The thesis's reward against the distance (figure 3.8), and PPO's clipped objective."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import ArrayLike

from kinreach.plots import FAINT, INK, PALETTE, colours_of, label_ends, new_figure
from kinreach.thesis import REACHED_DISTANCE, distance_reward


def draw_distance_reward(*, farthest: float = 3.0) -> Figure:
    """Draw the reward of the distance, r_d, with its two pieces (thesis, figure 3.8).

    Args:
        farthest: End of the axis [m], beyond 2 m, where the pieces meet.
    """
    figure, (ax,) = new_figure("The reward of the distance", size=(7.2, 3.9))
    near, far = np.geomspace(REACHED_DISTANCE, 2.0, 300), np.linspace(2.0, farthest, 50)
    ax.plot(near, distance_reward(near), color=PALETTE[0], lw=2)
    ax.plot(far, distance_reward(far), color=PALETTE[1], lw=2)
    ax.plot(2.0, 0.0, "o", ms=5, color=INK)
    ax.annotate("$r_d = 0.5 - 0.5\\,\\log_2 d$", (0.42, 1.25), color=PALETTE[0], fontsize=11)
    ax.annotate("$r_d = 1 - d/2$", (2.42, -0.07), color=PALETTE[1], fontsize=11)
    ax.annotate("both are 0 at d = 2 m", (2.0, 0.06), xytext=(2.0, 0.75), ha="center", color=INK, fontsize=9,
                arrowprops={"arrowstyle": "-", "color": FAINT})  # fmt: skip
    edge = float(distance_reward(REACHED_DISTANCE))
    ax.annotate(f"{edge:.2f} at d = {1e3 * REACHED_DISTANCE:g} mm; nearer, the special cases of the reward hold",
                (REACHED_DISTANCE, edge), xytext=(0.14, 3.72), fontsize=9, color=INK)  # fmt: skip
    ax.set(xlim=(0, farthest), xlabel="distance d from the tcp to the goal [m]", ylabel="$r_d$")
    return figure


def draw_reward_sections(
    distances: ArrayLike, rewards: Mapping[str, ArrayLike], *, title: str, note: str = ""
) -> Figure:
    """Draw the whole reward against the distance, a line for each posture, special cases included.

    Args:
        distances: Positive and increasing [m], shape (n,).
        rewards: Posture -> rewards, shape (n,).
        title: Of the figure.
        note: Small print.
    """
    d = np.asarray(distances)
    figure, (ax,) = new_figure(title, size=(9.0, 4.2), note=note)
    colours = colours_of(rewards)
    starts = {}
    for name, values in rewards.items():
        r = np.asarray(values)
        ax.plot(1e3 * d, r, color=colours[name], lw=1.8)
        starts[name] = (1e3 * d[0], r[0])
    ax.set(
        xscale="log",
        xlim=(1e3 * d[0], 1e3 * d[-1]),
        xlabel="distance d from the tcp to the goal [mm]",
        ylabel="reward r",
    )
    ax.xaxis.set_major_formatter("{x:g}")
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.yaxis.tick_right()
    ax.yaxis.set_label_position("right")
    ax.axvline(1e3 * REACHED_DISTANCE, color=FAINT, lw=1, ls="--", zorder=0)
    label_ends(ax, starts, colours, side="left")
    return figure


def draw_clipped_objective(*, epsilon: float = 0.2) -> Figure:
    """Draw PPO's clipped objective of one action against its probability ratio (thesis, figures 2.4 and 2.5).

        L = min(r A, clip(r, 1 - epsilon, 1 + epsilon) A)

    Left for the advantage A = 1, right for A = -1. The dotted line is the objective without the clip.

    Args:
        epsilon: Clip range of the ratio, between 0 and 1.
    """
    note = "dot: where every update begins, the new policy being the old one · dotted: without the clip"
    figure, axes = new_figure("PPO's clipped objective of one action", size=(9.0, 3.7), columns=2, note=note)
    ratio = np.array(sorted([*np.linspace(0.0, 2.0, 101), 1 - epsilon, 1 + epsilon]))
    cases: Sequence[tuple[float, float, str]] = (
        (1.0, 1 + epsilon, "A > 0: better than expected (figure 2.4)"),
        (-1.0, 1 - epsilon, "A < 0: worse than expected (figure 2.5)"),
    )
    for ax, colour, (advantage, bend, name) in zip(axes, PALETTE, cases, strict=False):
        objective = np.minimum(ratio * advantage, np.clip(ratio, 1 - epsilon, 1 + epsilon) * advantage)
        ax.plot(ratio, ratio * advantage, color=FAINT, lw=1, ls=":")
        ax.plot(ratio, objective, color=colour, lw=2.2)
        ax.plot(1.0, advantage, "o", ms=6, color=PALETTE[3])
        ax.axvline(bend, color=FAINT, lw=0.8, ls="--", zorder=0)
        side = "+" if advantage > 0 else "−"
        ax.set(xlim=(0, 2), xlabel="probability ratio $r_t$, new to old", ylabel="$L^{CLIP}$ in units of |A|")
        ax.set_xticks([0, 0.5, 1, bend, 2], ["0", "", "1", f"1 {side} ε", "2"])
        ax.set_title(name, loc="left", fontsize=10, weight="bold", color=INK)
    return figure

"""A damaged UR5 whose policy learns again by trial and error: balls reached against episodes.

    python -m benchmarks.studies.relearning                                        # a table
    python -m benchmarks.studies.relearning --figure docs/images/relearning.png    # and a figure
    python -m benchmarks.studies.relearning --engine ray                           # each fault a task
    python -m benchmarks.studies.relearning | python -m benchmarks.studies.tables relearning

The faults, the task and its criterion are those of `benchmarks.studies.damage`. An episode is a move to a ball, at the
end of which the tip is seen, 0.14 mm off in the median. What learns is ranked PPO with the settings of `ranked-single`,
all weights, from that policy as it comes or from nothing; the learner knows neither the fault nor any kinematics.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
import torch
from gymnasium import spaces

from benchmarks.studies.damage import (
    FIRST,
    KINDS,
    SIGMA,
    Damage,
    damage,
    how_far,
    numeric,
    off_by,
    reached,
    share_of_faults,
)
from benchmarks.studies.parts import each, kept
from benchmarks.studies.tables import head, line
from kinreach._checks import Floats, check_count
from kinreach._files import make_writable, replacing
from kinreach._jobs import add_options
from kinreach._statistics import bootstrap_intervals, mean
from kinreach.baselines._networks import ACTIVATIONS, ObservationFeatures, PostureHead
from kinreach.baselines._policies import load_policy
from kinreach.baselines._policy_file import Network
from kinreach.baselines._ranked_ppo import AdaptiveRate, Exploration, normal_scores
from kinreach.baselines.random_arms import ur5
from kinreach.cli import Parser, finish
from kinreach.envs._reach.reach_task import goal_block
from kinreach.plots._colours import own_colour
from kinreach.plots._style import FAINT, FONT_SIZE, key, label_ends, new_figure, text_colour

PROG = "python -m benchmarks.studies.relearning"
POLICY, SHIPPED, NOTHING, KNOWN = "ranked-single", "the policy", "nothing", "IK, fault known"
#: Tries of a ball, how often and in how many parts an update goes over them, and how far a ratio counts from 1.
TRIES, EPOCHS, PARTS, CLIP = 8, 2, 4, 0.2
RATE = AdaptiveRate(first=1e-3, target_kl=0.05, decay=0.15)


@dataclass(frozen=True)
class Start:
    """How to learn from something.

    Attributes:
        exploration: Standard deviation of the actions, in half turns.
        balls: Of an update.
        budgets: Numbers of episodes.
        faults: Of each kind, at most; None for all.
    """

    exploration: Exploration
    balls: int
    budgets: Sequence[int]
    faults: int | None = None


#: From a policy that is a little wrong, and from one that knows nothing; chosen on other faults (seeds from 10 on).
STARTS = {
    SHIPPED: Start(Exploration(0.05, 3e-4, 0.85), 32, (0, 1_000, 3_000, 10_000, 30_000, 100_000)),
    NOTHING: Start(Exploration(0.2, 3e-4, 0.85), 128, (100_000, 300_000, 1_000_000), 20),
}
#: Of a fault and a start, by episodes: share of balls reached, median distance [mm], processor time [s].
Curve = Mapping[int, tuple[float, float, float]]


def actor_of(network: Network, *, fresh: bool = False) -> torch.nn.Sequential:
    """A policy's network, to go on learning; a fresh one has forgotten all."""
    space = spaces.Box(-np.inf, np.inf, network.mean.shape)
    parts: list[torch.nn.Module] = [
        ObservationFeatures(
            space, mean=network.mean.tolist(), scale=network.scale.tolist(), waves=network.waves.tolist()
        )
    ]
    for weight, _ in network.layers[:-1]:
        parts += [torch.nn.Linear(*weight.shape[::-1]), ACTIVATIONS[network.activation]()]
    last = network.layers[-1][0].shape[1]
    parts.append(PostureHead(last, gain=network.gain.tolist(), shift=network.shift.tolist()))
    if not fresh:
        layers = (part for part in parts if isinstance(part, torch.nn.Linear))
        for layer, (weight, bias) in zip(layers, network.layers, strict=True):
            layer.weight.data.copy_(torch.as_tensor(weight))
            layer.bias.data.copy_(torch.as_tensor(bias))
    return torch.nn.Sequential(*parts)


def outcome(fault: Damage, actions: Floats, balls: Floats, noise: Floats) -> Floats:
    """How good moves of a damaged arm to balls (n, 3) look: 0 at best, above -1 what counts as reached, shape (n,)."""
    return -how_far(fault, math.pi * np.clip(actions, -1.0, 1.0), balls - noise)


def learn(fault: Damage, actor: torch.nn.Module, start: Start, episodes: int, seed: int) -> None:
    """Ranked PPO on so many episodes of the damaged arm."""
    rng, cell = np.random.default_rng((seed, 1)), fault.arm.workcell
    optimizer = torch.optim.Adam(actor.parameters(), betas=(0.9, 0.99), eps=1e-5)
    updates, rate = max(1, episodes // (TRIES * start.balls)), RATE.first
    for update in range(updates):
        balls = np.repeat(cell.draw_goals(rng, start.balls), TRIES, axis=0)
        seen = torch.as_tensor(goal_block(ur5().arm, balls), dtype=torch.float32)
        std = start.exploration.at(update / updates)
        with torch.no_grad():
            before = actor(seen)
        noise = rng.normal(0.0, std, (len(balls) // 2, 6))
        actions = before.numpy() + np.stack([noise, -noise], axis=1).reshape(-1, 6)  # antithetic pairs
        outcomes = outcome(fault, actions, balls, rng.normal(0.0, SIGMA, balls.shape))
        better = torch.as_tensor(normal_scores(outcomes.reshape(-1, TRIES)).ravel(), dtype=torch.float32)
        taken = torch.as_tensor(actions, dtype=torch.float32)
        old = (taken - before).square().sum(1)
        for group in optimizer.param_groups:
            group["lr"] = rate * RATE.share(update / updates)
        for rows in torch.cat([torch.randperm(len(balls)) for _ in range(EPOCHS)]).chunk(EPOCHS * PARTS):
            now = (taken[rows] - actor(seen[rows])).square().sum(1)
            ratio = ((old[rows] - now) / (2 * std**2)).exp()
            gain = torch.minimum(ratio * better[rows], ratio.clamp(1 - CLIP, 1 + CLIP) * better[rows])
            optimizer.zero_grad()
            (-gain.mean()).backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(actor.parameters(), 0.5)
            optimizer.step()
        with torch.no_grad():
            rate = RATE.after(rate, float((actor(seen) - before).square().sum(1).mean()) / (2 * std**2))


def found_before(kind: str, number: int, seed: int, start: str, count: int, most: int, folder: str) -> Curve:
    """The result of `curve`, from its file if there is one."""
    key = {"kind": kind, "fault": number, "seed": seed, "start": start, "balls": count, "most": most}
    found = kept(Path(folder), key, lambda: list(curve(kind, number, seed, start, count, most).items()))
    return {episodes: (share, middle, took) for episodes, (share, middle, took) in found}


def curve(kind: str, number: int, seed: int, start: str, count: int, most: int) -> Curve:
    """What is reached after so many episodes, each number of them learned from the start.

    Args:
        kind: Of the fault.
        number: Of the fault, the seed that it is drawn by.
        seed: Of the learning.
        start: A key of `STARTS`, or `KNOWN`: no learning.
        count: Balls that are tried.
        most: Episodes.
    """
    rng = np.random.default_rng(number)
    fault = damage(kind, rng)
    balls = fault.arm.workcell.draw_goals(rng, count)
    if start == KNOWN:
        hits, middle = reached(fault, numeric(fault.chain, balls, stuck=fault.stuck, at=fault.at), balls)
        return {0: (hits / count, middle, 0.0)}
    torch.manual_seed(seed)
    begun = actor_of(load_policy(POLICY).network, fresh=start == NOTHING)
    seen = torch.as_tensor(goal_block(ur5().arm, balls), dtype=torch.float32)
    found = {}
    for episodes in budgets(start, most):
        actor, began = deepcopy(begun), process_time()
        if episodes:
            learn(fault, actor, STARTS[start], episodes, seed)
        took = process_time() - began
        with torch.no_grad():
            actions = actor(seen).numpy().astype(float)
        hits, middle = reached(fault, math.pi * np.clip(actions, -1.0, 1.0), balls)
        found[episodes] = (hits / count, middle, took)
    return found


def budgets(start: str, most: int) -> list[int]:
    """Numbers of episodes up to a largest."""
    return [0] if start == KNOWN else [episodes for episodes in STARTS[start].budgets if episodes <= most]


def draw(drawn: Mapping[tuple[str, str, int], Sequence[float]], file: Path) -> None:
    """Balls reached against episodes, a panel a kind of fault, a line a start, with 95 % intervals."""
    note = f"{PROG}; 95 % intervals over faults; dashed: IK, fault known"
    figure, panels = new_figure("A damaged arm learns again", size=(10.6, 4.0), columns=len(KINDS), note=note)
    colours = {f"from {SHIPPED}": own_colour("ranked-single"), f"from {NOTHING}": own_colour("random")}
    for kind, axes in zip(KINDS, panels, strict=True):
        ends = {}
        axes.axhline(100 * drawn[kind, KNOWN, 0][0], color=FAINT, lw=1.2, ls="--")
        for start in STARTS:
            colour = colours[f"from {start}"]
            own = {count: found for (one, other, count), found in drawn.items() if (one, other) == (kind, start)}
            shown = {count: found for count, found in own.items() if count}  # no episodes have no place on a log axis
            middle, low, high = 100 * np.array(list(shown.values())).T
            axes.fill_between(list(shown), low, high, color=colour, alpha=0.15, linewidth=0)
            axes.plot(list(shown), middle, color=colour, marker="o", ms=4, lw=1.6)
            ends[start] = (list(shown)[-1], middle[-1])
        axes.set(xscale="log", ylim=(-3, 103), xlabel="episodes")
        key(axes, f"{kind} · balls reached [%]")
        if axes is panels[-1]:  # the policy's line lies on that of the known fault: its name stands under it
            label_ends(axes, {f"from {NOTHING}": ends[NOTHING]}, colours)
            place = {"xy": ends[SHIPPED], "xytext": (0, -8), "textcoords": "offset points", "ha": "right", "va": "top"}
            colour = text_colour(colours[f"from {SHIPPED}"])
            axes.annotate(f"from {SHIPPED}", color=colour, fontsize=FONT_SIZE, weight="bold", **place)
    with replacing(file) as temporary:
        figure.savefig(temporary, format="png")


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, and draw a figure."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faults", type=int, default=60, help="of each kind (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=1, help="of the learning of each fault (default: %(default)s)")
    parser.add_argument("--balls", type=int, default=40, help="for each fault (default: %(default)s)")
    parser.add_argument("--most", type=int, default=1_000_000, help="episodes (default: %(default)s)")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="PNG file")
    parser.add_argument("--out", type=Path, default=Path("results/relearning"), help="where finished curves are kept")
    add_options(parser)
    arguments = parser.parse_args(argv)
    for name in ("faults", "seeds", "balls", "most"):
        check_count(f"--{name}", getattr(arguments, name))
    make_writable(arguments.out)
    count, most, out = arguments.balls, arguments.most, str(arguments.out.resolve())
    groups = [(kind, start) for kind in KINDS for start in (KNOWN, *STARTS) if budgets(start, most)]
    every = range(FIRST, FIRST + arguments.faults)
    faults = {KNOWN: every} | {name: every[: start.faults] for name, start in STARTS.items()}
    runs = {start: [(fault, seed) for fault in own for seed in range(arguments.seeds)] for start, own in faults.items()}
    parts = [(kind, fault, seed, start, count, most, out) for kind, start in groups for fault, seed in runs[start]]
    found = each(arguments, found_before, parts)
    drawn = {}
    cells: dict[tuple[str, int], list[str]] = defaultdict(list)
    seconds: dict[tuple[str, int], list[float]] = defaultdict(list)
    for kind, start in groups:
        curves = [next(found) for _ in runs[start]]
        for episodes in budgets(start, most):
            shares, middles, took = np.array([one[episodes] for one in curves]).T
            by_fault = shares.reshape(len(faults[start]), -1).mean(axis=1)
            ((low, high),) = bootstrap_intervals(by_fault, (mean,))
            drawn[kind, start, episodes] = (shares.mean(), low, high)
            cells[start, episodes].append(f"{share_of_faults(by_fault)}; {off_by(middles)}")
            seconds[start, episodes].append(took.mean())
    print(head("begun with", "episodes", "processor, s", *KINDS))
    for (start, episodes), row in cells.items():
        times = [f"{took:.2g}" for took in (min(seconds[start, episodes]), max(seconds[start, episodes]))]
        took = "–".join(dict.fromkeys(times)) if episodes else "-"
        print(line(start, "-" if start == KNOWN else f"{episodes:,}".replace(",", " "), took, *row))
    if arguments.figure is not None:
        draw(drawn, arguments.figure)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

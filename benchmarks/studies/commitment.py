"""When must an arm learn to reach? Balls touched against how late the arm knows where the ball goes.

    python -m benchmarks.studies.commitment --figure map.png    # the whole map, with the networks of the logs
    python -m benchmarks.studies.commitment --trainings results/train/gradient-moving-clear    # with others
    python -m benchmarks.studies.commitment --learners benchmarks/logs/ppo-moving-tuned-late   # and with more learners
    python -m benchmarks.studies.commitment --methods network interception@3                   # only these
    python -m benchmarks.studies.commitment --delays 0.05 --hidden 0.2 --balls 201   # a strip that no camera sees
    python -m benchmarks.studies.commitment --times ...                    # how long each takes; with --figure, drawn

A world has a delay of the sights, a speed of the ball, a strength of the arm and a rule on collisions. Its place on the
axis is the time that the arm needs to make up for what the ball rolls unseen, over the time that the ball is above the
table: at 0 the arm may wait until it knows, from about 1 on it must move before. Balls come from one seed, in turn
straight, on a circle and with random sideways acceleration, the same for all methods. The network is that of the logs
that was trained with the delay; before a planner it acts for 24 frames. `interception@3` decides in every third frame.
Finished cells are kept in `--out`: an interrupted study goes on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from itertools import cycle, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.logs import FOLDER, policies_in
from benchmarks.studies.moving_ball import RULES, Timed, make_world
from benchmarks.studies.parts import counted, kept
from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import POLICY, trainings_interval, with_interval
from kinreach import _provenance as provenance
from kinreach._checks import check_count, check_known
from kinreach._files import make_writable, replacing
from kinreach.baselines import load_policy
from kinreach.baselines._loop import as_policy, rollout
from kinreach.baselines.inside import LearnedPolicy
from kinreach.cli import Parser, finish
from kinreach.compare._methods.interception import Interception
from kinreach.compare._methods.scenarios import Scenarios
from kinreach.compare._task import get_task
from kinreach.envs.moving import PATHS, travel_times
from kinreach.errors import InputError
from kinreach.plots._style import new_figure, plain_ticks
from kinreach.robots import THESIS_ARM, get_arm

PROG = "python -m benchmarks.studies.commitment"
#: Delays [s], speeds [m/s] and strengths of the arm.
DELAYS, SPEEDS, STRENGTHS = (0.05, 0.2), (0.4, 0.8, 1.2), (1.0, 0.7)
#: Planners that may decide in every so many frames, and after a policy.
PLANNERS: dict[str, Any] = {"interception": Interception, "scenarios": Scenarios}
#: A network alone and before a planner, and the methods of the map.
NETWORK, FIRST = "network", "network-then-"
METHODS = (*PLANNERS, NETWORK, f"{FIRST}interception")
#: What points of a figure are called.
SHAPES = {"s": "squares", "o": "circles", "^": "triangles", "D": "diamonds"}
#: Trainings that are the network, by the delay with which they were trained [s].
NETWORKS = {0.05: FOLDER / "gradient-moving-clear", 0.2: FOLDER / "gradient-moving-late-weak"}
#: Seed of the balls, which nothing was chosen with, and balls whose frames are timed.
SEED, TIMED = 5252, 12


def lateness(delay: float, speed: float, strength: float = 1.0) -> float:
    """Return the place of a world on the axis.

    The arm turns its first joint, from rest to rest, by what a ball in the middle of the area rolls in the delay [s] at
    a speed [m/s]; the ball rolls over the shorter side of the area.
    """
    arm = get_arm(THESIS_ARM)
    area: Any = arm.workcell.goals
    angle = delay * speed / (sum(area.x) / 2.0)
    limits = {"speed": strength * arm.speed_limit, "acceleration": strength * arm.acceleration_limit}
    needed = travel_times(np.zeros((1, 1)), np.zeros((1, 1)), np.full((1, 1), angle), **limits)
    return float(needed[0, 0]) * speed / (area.x[1] - area.x[0])


class World(NamedTuple):
    """A cell's world: its place on the axis, delay of the sights [s], ball's speed [m/s], arm's strength, and rule."""

    axis: float
    delay: float
    speed: float
    strength: float
    rule: str

    @property
    def options(self) -> dict[str, Any]:
        """Of the environment."""
        return {"delay": self.delay, "speeds": (self.speed,), "strength": self.strength, **RULES[self.rule]}

    @property
    def cells(self) -> tuple[str, ...]:
        """Of a table."""
        return f"{self.axis:.2f}", f"{1e3 * self.delay:g}", f"{self.speed:g}", f"{self.strength:g}", self.rule


def touched(
    method: str, file: Path | None, options: Mapping[str, Any], *, balls: int, seed: int, out: Path
) -> list[bool]:
    """Return which balls a method touches, or the policy in a file, alone or before the planner."""

    def played() -> list[bool]:
        env = make_world(options)
        resets = get_task("moving").resets(balls, seed, env)
        return [bool(trial["reached"]) for trial in rollout(env, as_policy(_made(method, file, env)), resets)]

    policy = "" if file is None else provenance.digest(file.read_bytes())
    return kept(out, {"method": method, "file": policy, **options, "balls": balls, "seed": seed}, played)


def frame_time(method: str, file: Path | None, options: Mapping[str, Any], *, seed: int) -> float:
    """Return the mean processor time of a frame [s], over `TIMED` balls after one that warms up."""
    env = make_world(options)
    timed = Timed(as_policy(_made(method, file, env)))
    for balls in (1, TIMED):
        timed.decisions.clear()
        list(rollout(env, timed, get_task("moving").resets(balls, seed, env)))
    return 1e-3 * float(np.mean(timed.decisions))


def _made(method: str, file: Path | None, env: Any) -> Any:
    if file is None or method.startswith(FIRST):
        return _planner(method.removeprefix(FIRST), env, None if file is None else load_policy(file))
    return load_policy(file)


def _planner(method: str, env: Any, first: LearnedPolicy | None = None) -> Any:
    """Make a method of the task; a planner may decide in every so many frames, as `interception@3`, after a policy."""
    if "@" not in method and first is None:
        return get_task("moving").methods[method].make(env)
    name, every = _planner_options(method)
    return PLANNERS[name](env, every=every, first=first)


def _planner_options(method: str) -> tuple[str, int]:
    """Return a planner, and the frames from one of its decisions to the next."""
    name, at, every = method.partition("@")
    if name not in PLANNERS or not (every.isdecimal() or not at):
        raise InputError(f"--methods: NAME@FRAMES with one of {', '.join(PLANNERS)}, got {method!r}")
    return name, check_count(f"frames of {method}", int(every)) if at else 1


def _parser() -> Parser:
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--trainings",
        type=Path,
        help="folder of the network's trainings (default: those of benchmarks/logs with the delay)",
    )
    parser.add_argument(
        "--learners", type=Path, nargs="+", default=[], help="folders of other trainings; their names are methods"
    )
    parser.add_argument(
        "--methods", nargs="+",
        help=f"of compare --task moving, {NETWORK}, {FIRST}PLANNER, PLANNER@FRAMES (default: {' '.join(METHODS)})",
    )  # fmt: skip
    parser.add_argument("--delays", type=float, nargs="+", default=DELAYS, help="[s] (default: %(default)s)")
    parser.add_argument("--speeds", type=float, nargs="+", default=SPEEDS, help="[m/s] (default: %(default)s)")
    parser.add_argument(
        "--strengths", type=float, nargs="+", default=STRENGTHS, help="of the arm (default: %(default)s)"
    )
    parser.add_argument("--hidden", type=float, help="width of the strip that no camera sees [m] (default: none)")
    parser.add_argument("--rule", choices=RULES, nargs="+", default=[*RULES], help="on collisions (default: both)")
    parser.add_argument("--balls", type=int, default=96, help="in each cell (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=SEED, help="of the balls (default: %(default)s)")
    parser.add_argument(
        "--out", type=Path, default=Path("results/commitment"), help="where finished cells are kept (%(default)s)"
    )
    parser.add_argument("--times", action="store_true", help="processor time of a frame, for --figure too")
    parser.add_argument("--figure", type=Path, help="where the shares are drawn against the axis")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Print Markdown tables."""
    arguments = _parser().parse_args(argv)
    balls = check_count("--balls", arguments.balls)
    seed = check_count("--seed", arguments.seed, least=0)
    learners = {folder.name: folder for folder in arguments.learners}
    names = [*(arguments.methods or METHODS), *(folder.name for folder in arguments.learners)]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise InputError(f"two methods are named {', '.join(twice)}; folders of --learners are methods by their names")
    afterwards = [FIRST + name for name in PLANNERS]
    for name in arguments.methods or ():
        check_known("method", name.partition("@")[0], (*get_task("moving").methods, NETWORK, *afterwards))
        if "@" in name:
            _planner_options(name.removeprefix(FIRST))
    make_writable(arguments.out)
    worlds = sorted(
        World(lateness(delay, speed, strength), delay, speed, strength, rule)
        for delay in arguments.delays
        for speed in arguments.speeds
        for strength in arguments.strengths
        for rule in arguments.rule
    )
    files = {delay: {name: _files(name, delay, arguments.trainings, learners) for name in names}
             for delay in arguments.delays}  # fmt: skip
    hidden = {} if arguments.hidden is None else {"hidden": arguments.hidden}
    if arguments.times:
        first = worlds[0]
        times = {
            name: frame_time(name, own[0], {**first.options, **hidden}, seed=seed)
            for name, own in files[first.delay].items()
        }
        print(head("method", "ms a frame"))
        for name, seconds in times.items():
            print(line(f"`{name}`", f"{1e3 * seconds:.2g}"))
        if arguments.figure is None:
            return 0
    place = ("axis", "delay, ms", "speed, m/s", "strength", "collisions")
    print(head(*place, *(f"`{name}`" for name in names)))
    cells: dict[str, list[np.ndarray]] = {name: [] for name in names}
    with counted(sum(len(own) for world in worlds for own in files[world.delay].values())) as done:
        for world in worlds:
            for name, own in files[world.delay].items():
                rows = []
                for file in own:
                    rows.append(
                        touched(name, file, {**world.options, **hidden}, balls=balls, seed=seed, out=arguments.out)
                    )
                    done()
                cells[name].append(np.array(rows))
            shares = (with_interval(cells[name][-1], unit=100, decimals=1) for name in names)
            print(line(*world.cells, *shares), flush=True)
    _print_differences(cells, worlds, place, [name for name, own in files[worlds[0].delay].items() if own != [None]])
    print("\n" + head(*place, *(f"`{name}`" for name in names)))
    for row, world in enumerate(worlds):
        print(line(*world.cells, *(by_path(cells[name][row]) for name in names)))
    print(f"\nBalls touched, in %, of {balls} a world (seed {seed}), with 95 % intervals over trainings and balls; "
          f"what learners touch more, of the same balls; and by kind of path: {', '.join(PATHS)}.")  # fmt: skip
    if arguments.figure is None:
        return 0
    if arguments.times:
        draw_times(cells, times, worlds, arguments.figure)
    else:
        draw(cells, worlds, arguments.figure)
    return 0


def _files(name: str, delay: float, trainings: Path | None, learners: Mapping[str, Path]) -> list[Path] | list[None]:
    """Return the policies of a method's trainings; a method that is not trained has None."""
    if name in learners:
        folder: Path | None = learners[name]
    elif name == NETWORK or name.startswith(FIRST):
        folder = trainings or NETWORKS.get(delay)
    else:
        return [None]
    found = policies_in(folder) if folder else []
    if not found:
        raise InputError(
            f"`{name}` needs --trainings with finished trainings, seed-0/{POLICY} and others: "
            + (f"{folder} has none" if folder else f"the logs have none for sights {delay:g} s late")
        )
    return found


def _print_differences(
    cells: Mapping[str, list[np.ndarray]], worlds: list[World], place: tuple[str, ...], learned: list[str]
) -> None:
    """Print what learners touch more than planners, if there are both."""
    planners = [name for name in cells if name in PLANNERS]
    if not planners or not learned:
        return
    print("\n" + head(*place, "method", *(f"less `{name}`" for name in planners)))
    for row, world in enumerate(worlds):
        for name in learned:
            less = (difference(cells[name][row], cells[planner][row]) for planner in planners)
            print(line(*world.cells, f"`{name}`", *less))


def by_path(touched: np.ndarray) -> str:
    """Return the shares of the balls of each kind of path [%]."""
    kinds = (touched[:, kind :: len(PATHS)] for kind in range(len(PATHS)))
    return " / ".join(f"{100.0 * own.mean():.0f}" if own.size else "–" for own in kinds)


def difference(touched: np.ndarray, others: np.ndarray) -> str:
    """Return how many percent more balls some trainings touch than a planner, with the interval over both."""
    apart = touched.astype(float) - others.astype(float)
    middle, low, high = (100.0 * value for value in (apart.mean(), *trainings_interval(apart, least=-1.0, most=1.0)))
    return f"{middle:+.1f} [{low:+.1f}, {high:+.1f}]"


def draw(cells: Mapping[str, list[np.ndarray]], worlds: list[World], file: Path) -> None:
    """Draw the share of touched balls against the axis, a panel for each rule; weaker arms have hollow points."""
    rules, most = sorted({world.rule for world in worlds}, reverse=True), max(world.axis for world in worlds)
    strengths = sorted({world.strength for world in worlds}, reverse=True)
    marks = dict(zip(sorted({world.delay for world in worlds}), cycle(("s--", "o-", "^:", "D-.")), strict=False))
    said = [f"{SHAPES[mark[0]]}: {1e3 * delay:g} ms late" for delay, mark in marks.items()]
    said += [f"hollow: an arm of {100 * strength:.0f} %" for strength in strengths[1:]]
    figure, panels = new_figure(
        "Balls touched, by how late the arm knows", size=(4.2 * len(rules) + 2.8, 4.2), columns=len(rules),
        note=" · ".join([f"{_balls(cells)} balls a world", "bars: 95 % intervals over trainings and balls", *said]),
    )  # fmt: skip
    for rule, panel in zip(rules, panels, strict=True):
        for index, (name, found) in enumerate(cells.items()):
            for strength, (delay, mark) in product(strengths, marks.items()):
                here = (delay, strength, rule)
                rows = [row for row, world in enumerate(worlds) if (world.delay, world.strength, world.rule) == here]
                if not rows:
                    continue
                shares, errors = _with_errors([found[row] for row in rows])
                places = np.array([worlds[row].axis for row in rows]) + 0.004 * most * (index - len(cells) / 2.0)
                full = {"fmt": mark} if strength == strengths[0] else {"fmt": mark[0], "mfc": "none", "alpha": 0.8}
                panel.errorbar(places, shares, yerr=errors, color=_colour(name, cells), ms=4, lw=1.2, **full)
            panel.plot([], [], "o", color=_colour(name, cells), ms=5, label=name)
        panel.set_ylim(0.0, 102.0)
        panel.set_xlim(0.0, 1.05 * most)
        panel.set_title(f"collisions {rule}", fontsize=10)
        panel.set_xlabel("time to make up for what is unseen /\ntime of the ball above the table")
    panels[0].set_ylabel("balls touched [%]")
    panels[-1].legend(frameon=False, fontsize=8)
    _saved(figure, file)


def draw_times(
    cells: Mapping[str, list[np.ndarray]], times: Mapping[str, float], worlds: list[World], file: Path
) -> None:
    """Draw the share of touched balls against the processor time of a frame [s], a panel for each world."""
    figure, panels = new_figure(
        "Balls touched, by the time of a decision", size=(3.0 * len(worlds) + 0.6, 3.4), columns=len(worlds),
        note=f"{_balls(cells)} balls a world · bars: 95 % intervals over trainings and balls{_pauses(cells)}",
    )  # fmt: skip
    families: dict[str, list[str]] = {}
    for name in cells:
        families.setdefault(name.partition("@")[0], []).append(name)
    varied = [field for field in ("strength", "rule") if len({getattr(world, field) for world in worlds}) > 1]
    for index, (world, panel) in enumerate(zip(worlds, panels, strict=True)):
        for family, names in families.items():
            shares, errors = _with_errors([cells[name][index] for name in names])
            taken = [1e3 * times[name] for name in names]
            colour = _colour(family, families)
            panel.errorbar(taken, shares, yerr=errors, fmt="o-", color=colour, ms=5, lw=1.2, label=family)
        panel.set_xscale("log")
        panel.set_ylim(0.0, 102.0)
        said = {"strength": f"strength {world.strength:g}", "rule": f"collisions {world.rule}"}
        title = f"{world.speed:g} m/s, {1e3 * world.delay:g} ms late"
        panel.set_title(", ".join([title, *(said[field] for field in varied)]), fontsize=10)
        panel.set_xlabel("processor time of a frame [ms]")
        plain_ticks(panel.xaxis)
    panels[0].set_ylabel("balls touched [%]")
    panels[-1].legend(frameon=False, fontsize=8)
    _saved(figure, file)


def _colour(name: str, names: Iterable[str]) -> str:
    """Return the colour of a method: the same in all figures of the map's methods."""
    others = [other for other in names if other not in METHODS]
    return f"C{METHODS.index(name) if name in METHODS else len(METHODS) + others.index(name)}"


def _balls(cells: Mapping[str, list[np.ndarray]]) -> int:
    return int(next(iter(cells.values()))[0].shape[1])


def _pauses(names: Iterable[str]) -> str:
    """What a note says of planners that do not decide in every frame."""
    frames = sorted({int(every) for name in names if (every := name.partition("@")[2])})
    return f" · on a line: a decision in 1, {', '.join(map(str, frames))} frames" if frames else ""


def _with_errors(found: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return shares of touched balls [%], and how far their intervals go down and up, shape (2, n)."""
    shares = np.array([100.0 * each.mean() for each in found])
    bounds = 100.0 * np.array([trainings_interval(each) for each in found]).T
    return shares, np.maximum(np.abs(bounds - shares), 0.0)


def _saved(figure: Any, file: Path) -> None:
    with replacing(file) as temporary:
        figure.savefig(temporary, format="png")


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

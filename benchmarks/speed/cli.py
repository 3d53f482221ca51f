"""The command line of the benchmark."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from benchmarks.speed.report import TARGET_COLUMNS, figures_of, sections_of, show, target_cells, write_page
from benchmarks.speed.run import run_suites
from benchmarks.speed.sections import Options, Section, Target
from benchmarks.speed.suites import SUITES, chosen
from kinreach._checks import check_count, check_path
from kinreach._files import make_writable, read_text
from kinreach.cli import Parser
from kinreach.errors import InputError

ROUNDS, QUICK_ROUNDS = 7, 3
OUT = Path("results") / "bench"
#: Of the numbers of a page [bytes].
MAX_BYTES = 16 * 1024 * 1024
#: Narrowest that tables are set [characters].
WIDTH = 120
_EPILOG = "suites:\n" + "\n".join(f"  {name:14s} {summary}" for name, summary in SUITES.items())


def main(argv: Sequence[str], *, prog: str) -> int:
    """Run suites and show their tables.

    Args:
        argv: Arguments without the program's name.
        prog: How the user called it, for messages and for the command in the results.

    Returns:
        Exit code 0, also where a target is missed; anything else is raised.

    Raises:
        KinreachError: Bad input, a directory that cannot be written, a package that every row needs.
        KeyboardInterrupt: With a message that says what was kept.
    """
    arguments = _parser(prog).parse_args(argv)
    suites = chosen(arguments.suite)
    rounds = arguments.rounds if arguments.rounds is not None else QUICK_ROUNDS if arguments.quick else ROUNDS
    options = Options(
        rounds=check_count("rounds", rounds),
        quick=arguments.quick,
        seed=check_count("the seed", arguments.seed, least=0),
    )
    out = OUT if arguments.out is None else check_path("--out", arguments.out)
    page = None if arguments.docs is None else _page(arguments.docs)
    if arguments.redraw:
        return _redraw(page)
    results = _measure(suites, options, out, fresh=arguments.fresh, command=_command(prog, suites, options))
    console = _console()
    targets = [target for section in sections_of(results) for target in section.targets]
    if targets:
        console.print(_targets(targets))
        console.print()
    written = [f"{out}/results.json", f"{out}/results.md"]
    if any((out / "figures").glob("*.png")):
        written.append(f"{out}/figures")
    if page is not None:
        write_page(results, page)
        written.append(str(page))
    console.print(f"Written: {', '.join(written)}", style="dim", soft_wrap=True)
    return 0


def _redraw(page: Path | None) -> int:
    """Write a page and its figures again from the numbers beside it.

    Raises:
        InputError: There is no page, or there are no numbers beside it.
    """
    if page is None:
        raise InputError("--redraw needs the page, --docs PAGE.md")
    text = read_text(page.with_suffix(".json"), "the numbers of the page", most=MAX_BYTES)
    write_page(json.loads(text), page)
    print(f"Written: {page}, {figures_of(page)}")
    return 0


def _page(docs: str) -> Path:
    """Where the page of the documentation goes; told now, not after ten minutes of measuring, if it cannot.

    Raises:
        InputError: It is no path, a directory or a device, or where the page's data goes.
        OutputError: The directories cannot be written.
    """
    page = check_path("--docs", docs)
    if not page.name or (page.exists() and not page.is_file()):
        raise InputError(f"--docs must be a file, got {docs!r}")
    if page.suffix == ".json":
        raise InputError(f"--docs must be a page of Markdown; its numbers go to {page}")
    for folder in (page.parent, figures_of(page).parent):
        make_writable(folder)
    return page


def _measure(suites: Sequence[str], options: Options, out: Path, *, fresh: bool, command: str) -> dict[str, object]:
    """Run under a progress bar; Ctrl-C becomes a line that says what was kept."""
    console = _console()
    finished: list[str] = []
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    # Drawn between rounds, not by a thread of its own that would run into what is timed.
    with (
        _errors() as errors,
        Progress(
            *columns, console=errors, transient=True, auto_refresh=False, disable=not errors.is_interactive
        ) as bar,
    ):
        shown = bar.add_task("", total=None)

        def progress(what: str, done: int, total: int) -> None:
            bar.update(shown, description=what, completed=done, total=total, refresh=True)

        def on_suite(suite: str, sections: Sequence[Section], kept: bool) -> None:
            finished.append(suite)
            bar.stop()  # a table would start on its line
            if kept:
                errors.print(f"{suite}: kept from an interrupted run (--fresh starts over)")
            for section in sections:
                console.print(_table(section))
                for name, why in section.missing.items():
                    console.print(f"Missing: {name}: {' '.join(why.split())}", style="dim", soft_wrap=True)
                console.print()
            bar.start()

        try:
            return run_suites(
                suites, options, out,
                command=command, fresh=fresh, progress=progress, on_suite=on_suite,
                say=partial(errors.print, soft_wrap=True),
            )  # fmt: skip
        except KeyboardInterrupt:
            kept = f"{len(finished)} of {len(suites)} suites are kept in {out}"
            raise KeyboardInterrupt(f"interrupted; {kept}; the same command goes on from there") from None


@contextlib.contextmanager
def _errors() -> Iterator[Console]:
    """Standard error; on a terminal by a descriptor of its own, which stays while suites silence their peers."""
    if not sys.stderr.isatty():
        yield Console(stderr=True)
        return
    width = Console(stderr=True).width
    with open(os.dup(sys.stderr.fileno()), "w", encoding=sys.stderr.encoding) as terminal:
        yield Console(file=terminal, width=width)


def _console() -> Console:
    console = Console(highlight=False)
    return Console(highlight=False, markup=False, width=max(console.width, WIDTH))


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="Measure speed beside other packages, in one run.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--suite", metavar="A,B", help="suites to run (default: all)")
    parser.add_argument("--quick", action="store_true", help="small sizes: shows that it works, in a minute")
    parser.add_argument("--rounds", type=int, metavar="N", help=f"default: {ROUNDS}, with --quick {QUICK_ROUNDS}")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of poses and goals (default: %(default)s)")
    parser.add_argument("--out", metavar="DIR", help=f"where results go (default: {OUT})")
    parser.add_argument(
        "--docs", metavar="FILE", help="also write a page of the documentation, such as docs/reference/benchmarks.md"
    )
    parser.add_argument(
        "--redraw", action="store_true", help="measure nothing: write --docs from the numbers beside it"
    )
    parser.add_argument("--fresh", action="store_true", help="do not go on from an interrupted run in DIR")
    return parser


def _command(prog: str, suites: Sequence[str], options: Options) -> str:
    """The command that asks for this again; defaults are left out."""
    usual = QUICK_ROUNDS if options.quick else ROUNDS
    return (
        prog
        + ("" if tuple(suites) == tuple(SUITES) else f" --suite {','.join(suites)}")
        + (" --quick" if options.quick else "")
        + (f" --rounds {options.rounds}" if options.rounds != usual else "")
        + (f" --seed {options.seed}" if options.seed else "")
    )


def _table(section: Section) -> Table:
    table = Table(title=section.title, title_style="bold", title_justify="left", box=None, pad_edge=False)
    for number, name in enumerate(section.columns):
        table.add_column(name, justify="right" if number and _numbers(section, number) else "left")
    for row in section.rows:
        table.add_row(*map(show, row))
    return table


def _numbers(section: Section, column: int) -> bool:
    return not any(isinstance(row[column], str) for row in section.rows)


def _targets(targets: Sequence[Target]) -> Table:
    title = f"Targets: {sum(target.met for target in targets)} of {len(targets)} met"
    table = Table(title=title, title_style="bold", title_justify="left", box=None, pad_edge=False)
    for name in TARGET_COLUMNS:
        table.add_column(name)
    for target in targets:
        table.add_row(*target_cells(target))
    return table

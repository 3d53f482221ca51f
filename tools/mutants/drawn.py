"""Whether the tests notice mistakes that nobody chose: random changes of the syntax tree, one at a time.

    python -m tools.mutants.drawn --seed 1 --count 100 [--only ROOM ...] [--map FILE] [--out FILE] [--full]

A module is drawn by its number of lines, then a line of it, then a change of that line: a comparison, an operator, a
number, a condition, an argument, a statement. Docstrings, annotations, assertions (`strict=` of `zip` is one) and what
an error says stay as they are. The fast tests that enter the function run, those of the module's own room first, then
the room's other tests, up to the first failure.
`--map FILE` says which they are; a run of the fast suite writes it if it is not there. With `--full` what survives them
meets the whole fast suite. A second call with the same `--out` goes on where the first stopped. `--only kinematics
compare/_methods` draws from modules of some rooms.

`drawn.toml` lists the changes that nobody can notice, with the reason. The exit code is 0 if at least `GOAL`
of all others were killed, else 1.
"""

from __future__ import annotations

import argparse
import ast
import copy as copies
import json
import os
import random
import subprocess
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

from kinreach._files import make_writable, write_text
from kinreach.cli import Parser, finish
from kinreach.errors import InputError
from tools.mutants.by_hand import GOAL, PYTEST, READERS, applied, copied, environment_in, killer

PROG = "python -m tools.mutants.drawn"

TABLE = Path(__file__).with_name("drawn.toml")
#: Time of the tests that run first, and of those of a room in which nothing enters what is changed [s].
FIRST, ROOM = 20.0, 60.0

COMPARED: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
CALCULATED: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_PAIRS = "any all, min max, ceil floor, minimum maximum, argmin argmax, zeros ones, sin cos, lower upper, low high"
SWAPPED = {a: b for pair in _PAIRS.split(", ") for a, b in (pair.split(), pair.split()[::-1])}
#: Arguments that are text for people.
TEXTS = ("help", "description", "epilog", "metavar", "title")


@dataclass(frozen=True)
class RandomMutant:
    """A change of one place.

    Attributes:
        file: Module, from the root of the checkout.
        start, end: Place of what is replaced in the module's bytes.
        line: Number of its first line, from 1.
        source: That line, without its indentation.
        old, new: What is replaced, and by what.
    """

    file: str
    start: int
    end: int
    line: int
    source: str
    old: str
    new: str

    @property
    def change(self) -> str:
        """What it does."""
        return " -> ".join(" ".join(text.split()) for text in (self.old, self.new))

    @property
    def id(self) -> str:
        """Where it is, and what it does."""
        return f"{self.file}:{self.line} {self.change}"

    @property
    def anywhere(self) -> tuple[str, str, str]:
        """As `id`, with the line's text in place of its number, which other changes move."""
        return self.file, self.source, self.change

    def applied(self, text: str) -> str:
        """The text of the module with the mistake in it."""
        given = text.encode()
        return (given[: self.start] + self.new.encode() + given[self.end :]).decode()


def changes(file: str, text: str) -> list[RandomMutant]:
    """Every change that may be drawn in a module."""
    lines = text.splitlines(keepends=True)
    starts = [0, *accumulate(len(line.encode()) for line in lines)]
    found = {}
    for node, new in _replacements(ast.parse(text)):
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        old = text.encode()[start:end].decode()
        if isinstance(node, ast.expr) and not isinstance(node, ast.Constant | ast.Name | ast.Call):
            new = f"({new})"
        new = new.replace("\n", "\n" + " " * node.col_offset)
        mutant = RandomMutant(file, start, end, node.lineno, lines[node.lineno - 1].strip(), old, new)
        found[mutant.id] = mutant
    return list(found.values())


def _replacements(node: ast.AST) -> Iterator[tuple[Any, str]]:
    """Nodes below one, with the texts that may replace them."""
    if isinstance(node, ast.Assign) and (ast.unparse(node.targets[0]) == "__all__" or _is_alias(node)):
        return
    yield from ((node, ast.unparse(each)) for each in _changed(node))
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        yield node.test, f"not ({ast.unparse(node.test)})"
    for child in _children(node):
        yield from _replacements(child)


def _is_alias(node: ast.Assign) -> bool:
    """Whether a name for a type is assigned, which only annotations use."""
    name = ast.unparse(node.targets[0])
    return isinstance(node.value, ast.Subscript) and name[:1].isupper() and not name.isupper()


def _children(node: Any) -> Iterator[ast.AST]:
    """Parts of a node in which something may be changed."""
    skipped: list[Any] = [getattr(node, name, None) for name in ("annotation", "returns", "type_comment")]
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert):
        return  # what is said; a text's parts have no places of their own
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return
    if isinstance(node, ast.Call):
        skipped += [keyword for keyword in node.keywords if keyword.arg in (*TEXTS, "strict")]
    yield from (child for child in ast.iter_child_nodes(node) if all(child is not one for one in skipped))


def _changed(node: Any) -> Iterator[ast.AST]:
    """What may stand in place of a node."""

    def other(**fields: Any) -> ast.AST:
        result = copies.copy(node)
        for name, value in fields.items():
            setattr(result, name, value)
        return result

    match node:
        case ast.Compare():
            for place, op in enumerate(node.ops):
                for kind in COMPARED[type(op)]:
                    yield other(ops=[*node.ops[:place], kind(), *node.ops[place + 1 :]])
        case ast.BinOp() if type(node.op) in CALCULATED:
            yield other(op=CALCULATED[type(node.op)]())
        case ast.AugAssign() if type(node.op) in CALCULATED:
            yield other(op=CALCULATED[type(node.op)]())
            yield ast.Pass()
        case ast.BoolOp():
            yield other(op=ast.And() if isinstance(node.op, ast.Or) else ast.Or())
            for place in range(len(node.values)):
                rest = [value for index, value in enumerate(node.values) if index != place]
                yield rest[0] if len(rest) == 1 else other(values=rest)
        case ast.UnaryOp():
            yield node.operand
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield ast.Constant(value + 1)
            if value:
                yield ast.UnaryOp(ast.USub(), node)
        case ast.Name(id=name) if name in SWAPPED:
            yield other(id=SWAPPED[name])
        case ast.Call():
            if isinstance(node.func, ast.Attribute) and node.func.attr in SWAPPED:
                function = copies.copy(node.func)
                function.attr = SWAPPED[node.func.attr]
                yield other(func=function)
            for place, keyword in enumerate(node.keywords):
                if keyword.arg not in (*TEXTS, "strict"):
                    yield other(keywords=[*node.keywords[:place], *node.keywords[place + 1 :]])
            if len(node.args) > 1:
                yield other(args=node.args[:-1])
        case ast.IfExp():
            yield other(body=node.orelse, orelse=node.body)
        case ast.Expr(value=ast.Call() | ast.Yield() | ast.Await()) | ast.Raise() | ast.Assign():
            yield ast.Pass()
        case ast.Return(value=value) if value is not None and ast.unparse(value) != "None":
            yield ast.Return(None)
        case ast.Continue():
            yield ast.Break()
        case ast.Break():
            yield ast.Continue()


def draw(texts: dict[str, str], seed: int, count: int) -> list[RandomMutant]:
    """Mutants of modules, drawn by their numbers of lines; none twice.

    Args:
        texts: Modules by their paths from the root.
        seed: The first of more are those of fewer.
        count: How many.
    """
    rng = random.Random(seed)
    files, drawn = list(texts), dict[str, RandomMutant]()
    weights = [len(text.splitlines()) for text in texts.values()]
    found: dict[str, dict[int, list[RandomMutant]]] = {}
    while len(drawn) < count:
        (file,) = rng.choices(files, weights)
        if file not in found:
            found[file] = {}
            for mutant in changes(file, texts[file]):
                found[file].setdefault(mutant.line, []).append(mutant)
        if found[file]:
            mutant = rng.choice(found[file][rng.choice(list(found[file]))])
            drawn[mutant.id] = mutant
    return list(drawn.values())


class Covering:
    """Which tests to run for a mutant.

    Args:
        path: File of `tools.mutants.covering`.
    """

    def __init__(self, path: Path) -> None:
        found = json.loads(path.read_text(encoding="utf-8"))
        self.seconds: dict[str, float] = found["seconds"]
        self._tests, self._lines = list(self.seconds), found["lines"]

    def stages(self, mutant: RandomMutant, text: str) -> list[list[str]]:
        """Tests that enter the function of a mutant, those to run first apart from the others; then its room's others.

        More tests use what a cached function returned than enter it. Where there is no such test, and outside of
        functions: all that enter one of the module, those of its room, and those of the whole package.
        """
        lines: dict[str, list[int]] = self._lines.get(mutant.file, {})
        inside = any(
            isinstance(node, ast.FunctionDef) and node.lineno <= mutant.line <= (node.end_lineno or 0)
            for node in ast.walk(ast.parse(text))
        )
        room = room_of(mutant)
        tests = {self._tests[number] for number in lines.get(str(mutant.line), []) if inside}
        if not tests:
            tests = {self._tests[number] for each in lines.values() for number in each}
            package = {test for test in self._tests if test.startswith(f"{'/'.join(room.split('/')[:2])}/")} - tests
            tests |= set(self._fast(sorted(package, key=self.seconds.__getitem__), ROOM))
            tests |= {test for test in self._tests if test.startswith("tests/test_")}
        kept = [test for test in tests if not test.startswith(READERS)]
        ordered = sorted(kept, key=lambda test: (not test.startswith(room), self.seconds[test]))
        first = self._fast(ordered, FIRST) or ordered[:1]
        rest = sorted(ordered[len(first) :], key=self.seconds.__getitem__)
        asked = {*kept, *READERS}
        others = [test for test in self._tests if test.startswith(room) and test not in asked]
        return [stage for stage in (first, rest, sorted(others, key=self.seconds.__getitem__)) if stage]

    def patience(self, tests: list[str]) -> float:
        """How long tests may take with a mutant [s]."""
        return 60.0 + 20.0 * sum(self.seconds[test] for test in tests)

    def _fast(self, tests: list[str], seconds: float) -> list[str]:
        """The first of some tests, that take so long together [s]."""
        spent = accumulate(self.seconds[test] + 0.05 for test in tests)
        return tests[: sum(each <= seconds for each in spent)]


class Forked:
    """A process that has collected the tests of a copy of the checkout.

    Args:
        copy: The copy.
    """

    def __init__(self, copy: Path) -> None:
        theirs, self._jobs = os.pipe()
        mine, answers = os.pipe()
        self._process = subprocess.Popen(
            [*PYTEST, "-p", "tools.mutants.forked", "tests"],
            cwd=copy,
            env={**environment_in(copy), "KINREACH_PIPES": f"{theirs} {answers}"},
            pass_fds=(theirs, answers),
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(theirs)
        os.close(answers)
        self._answers = os.fdopen(mine)

    def verdict(self, file: str, old: str, new: str, tests: list[str], patience: float) -> dict[str, Any]:
        """Which test fails first, as `killed_by`, None if none does; nothing for a change outside of functions.

        Args:
            file: Module that is changed, from the root of the copy.
            old: Its text.
            new: Its text with the change.
            tests: To run, in this order.
            patience: Longest time [s].
        """
        job = {"file": file, "old": old, "new": new, "tests": tests, "patience": patience}
        with os.fdopen(os.dup(self._jobs), "w") as jobs:
            jobs.write(json.dumps(job) + "\n")
        found: dict[str, Any] = json.loads(self._answers.readline())
        return found

    def close(self) -> None:
        """End the process."""
        os.close(self._jobs)
        self._answers.close()
        self._process.wait()


def room_of(mutant: RandomMutant) -> str:
    """The folder of the tests of a mutant's room, from the root."""
    return mutant.file.replace("kinreach/", "tests/", 1).rpartition("/")[0].replace("/_", "/")


def judge(
    copy: Path, mutant: RandomMutant, covering: Covering, *, full: bool, forked: Forked | None = None
) -> dict[str, Any]:
    """Which test kills a mutant, how many were asked, and how long it took [s].

    With a process that forks, a test that fails there has to fail in a new process too: else all are asked in new ones.
    """
    start, killed_by, asked = time.perf_counter(), None, 0
    text = (copy / mutant.file).read_text(encoding="utf-8")

    def new_process(tests: list[str]) -> str | None:
        chosen = copy / ".tests.json"
        chosen.write_text(json.dumps(tests), encoding="utf-8")
        files = list(dict.fromkeys(test.partition("::")[0] for test in tests))
        listed = ["-p", "tools.mutants.covering", *files]
        return killer(copy, listed, patience=covering.patience(tests), KINREACH_TESTS=str(chosen))

    def soon(tests: list[str]) -> str | None:
        nonlocal forked
        if forked is None:
            return new_process(tests)
        found = forked.verdict(mutant.file, text, mutant.applied(text), tests, covering.patience(tests))
        killing = found.get("killed_by")
        if found and (killing is None or "::" not in killing or new_process([killing])):
            return str(killing) if killing else None
        forked = None
        return new_process(tests)

    with applied(copy, mutant):
        for tests in covering.stages(mutant, text):
            asked += len(tests)
            if killed_by := soon(tests):
                break
        if killed_by is None and full:
            killed_by = killer(copy, [*(f"--ignore={name}" for name in READERS), "tests"])
    return {"killed_by": killed_by, "tests": asked, "seconds": round(time.perf_counter() - start, 1)}


def main(argv: list[str] | None = None) -> int:
    """Run the mutants, print what became of each, and the share that was killed."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="of the draw")
    parser.add_argument("--count", type=int, default=100, help="number of mutants (100)")
    parser.add_argument("--only", nargs="+", metavar="ROOM", default=[""], help="rooms to draw from (all)")
    parser.add_argument("--map", type=Path, default=Path("build/covering.json"), help="which tests enter what")
    parser.add_argument("--out", type=Path, help="results, kept between calls (build/random_mutants_SEED.json)")
    parser.add_argument("--full", action="store_true", help="run the whole fast suite on what covering tests let live")
    arguments = parser.parse_args(argv)
    out = arguments.out or Path(f"build/random_mutants_{arguments.seed}.json")
    for path in (out, arguments.map):
        make_writable(path.parent)
    results = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = copied(Path(folder))
        if not arguments.map.exists():
            write_map(copy, arguments.map.resolve())
        covering = Covering(arguments.map)
        rooms = tuple(f"kinreach/{room}/" if room else "kinreach/" for room in arguments.only)
        texts = {
            name: path.read_text(encoding="utf-8")
            for path in sorted(copy.glob("kinreach/**/*.py"))
            if (name := str(path.relative_to(copy))).startswith(rooms)
        }
        if not texts:
            raise InputError(f"there is no module in {' '.join(arguments.only)}")
        drawn = draw(texts, arguments.seed, arguments.count)
        pending = [mutant for mutant in drawn if mutant.id not in results]
        with closing(Forked(copy)) if pending else nullcontext() as forked:
            for mutant in pending:
                results[mutant.id] = judge(copy, mutant, covering, full=arguments.full, forked=forked)
                write_text(out, json.dumps(results, indent=1) + "\n")
                print(f"{results[mutant.id]['killed_by'] or 'SURVIVES'} | {mutant.id}", flush=True)
    return report(drawn, results)


def write_map(copy: Path, path: Path) -> None:
    """Run the fast suite in a copy, and write which tests enter what.

    Raises:
        InputError: A test fails.
    """
    if failed := killer(copy, ["-p", "tools.mutants.covering", "tests"], KINREACH_MAP=str(path)):
        raise InputError(f"without a mutant {failed} fails")


def equivalents() -> dict[tuple[str, str, str], str]:
    """Changes that nobody can notice, with the reasons, by file, text of the line and change."""
    entries = tomllib.loads(TABLE.read_text(encoding="utf-8"))["equivalent"]
    return {(entry["file"], entry["line"], entry["change"]): entry["why"] for entry in entries}


def report(drawn: Sequence[RandomMutant], results: dict[str, Any]) -> int:
    """Print what survives and the share that was killed."""
    known = equivalents()
    alive = [mutant for mutant in drawn if results[mutant.id]["killed_by"] is None]
    missed = [mutant for mutant in alive if mutant.anywhere not in known]
    counted = len(drawn) - len(alive) + len(missed)
    for mutant in alive:
        print(f"survives: {mutant.id}: {known.get(mutant.anywhere, 'NOT NOTICED')}")
    print(f"{counted - len(missed)} of {counted} killed; {len(alive) - len(missed)} more change nothing")
    return 0 if counted - len(missed) >= GOAL * counted else 1


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

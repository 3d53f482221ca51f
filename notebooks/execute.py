"""Run notebooks and keep what they show.

    python notebooks/execute.py [NOTEBOOK ...] [--check]

Without names all notebooks of this folder are run. Outputs are written into the files;
times and versions are not, so that running them again changes only what differs. With
`--check` nothing is written. It prints how long each took, and how long all: by the
clock, and the processor time, which a busy machine does not change much.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

FOLDER = Path(__file__).resolve().parent
#: What a cell may take [s].
TIMEOUT = 600
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def execute(path: Path) -> Any:
    """Return the notebook after a run, without what differs from run to run.

    Raises:
        CellExecutionError: A cell failed; the message shows it.
    """
    notebook = nbformat.read(path, as_version=4)
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": KERNEL, "language_info": {"name": "python"}}
    )
    client = NotebookClient(
        notebook,
        timeout=TIMEOUT,
        record_timing=False,
        coalesce_streams=True,  # lines that come late are no output of their own
        resources={"metadata": {"path": str(path.parent)}},
        extra_arguments=[
            "--log-level=40"
        ],  # it warns of unencrypted traffic, which stays on the loopback
    )
    client.execute()
    notebook.metadata.language_info = nbformat.from_dict({"name": "python"})
    for number, cell in enumerate(notebook.cells, start=1):
        cell.id = f"cell-{number}"
        cell.metadata.clear()
    nbformat.validate(notebook)
    return notebook


def main(argv: list[str] | None = None) -> int:
    """Run notebooks; the exit status is 1 if one failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "notebooks", nargs="*", type=Path, help="default: all of this folder"
    )
    parser.add_argument(
        "--check", action="store_true", help="only run them, write nothing"
    )
    args = parser.parse_args(argv)
    missing = [str(path) for path in args.notebooks if not path.is_file()]
    if missing:
        parser.error(f"no such notebook: {', '.join(missing)}")
    failed = False
    began, used = time.perf_counter(), _processor_time()
    for path in args.notebooks or sorted(FOLDER.glob("*.ipynb")):
        start, before = time.perf_counter(), _processor_time()
        try:
            notebook = execute(path.resolve())
        except CellExecutionError as error:
            print(f"{path.name}: failed\n{error}", file=sys.stderr)
            failed = True
            continue
        if not args.check:
            # a run that is broken off must not leave half a notebook
            temporary = path.with_suffix(".tmp")
            nbformat.write(notebook, temporary)
            temporary.replace(path)
        print(
            f"{path.name}: {_spent(start, before)}, {path.stat().st_size / 1e3:.0f} kB",
            flush=True,
        )
    print(f"altogether: {_spent(began, used)}")
    return int(failed)


def _spent(start: float, before: float) -> str:
    seconds, cpu = time.perf_counter() - start, _processor_time() - before
    return f"{seconds:.0f} s, {cpu:.0f} s of processor time"


def _processor_time() -> float:
    """Of this process, and of the kernels that have ended [s]."""
    usage = [
        resource.getrusage(who)
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    return sum(each.ru_utime + each.ru_stime for each in usage)


if __name__ == "__main__":
    sys.exit(main())

"""Put what examples print into `docs/guides/examples.md`.

    python docs/run_examples.py              # of all of them
    python docs/run_examples.py 09_seeing    # of some

They run in a folder of their own; pictures that they write to `results` go to `docs/images`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "guides/examples.md"


def run(name: str) -> str:
    """What an example prints; its pictures are kept."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", str(ROOT / "examples" / f"{name}.py")],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        for picture in Path(folder, "results").glob("*.[jp][pn]g"):
            shutil.copy(picture, ROOT / "docs" / "images" / picture.name)
    return done.stdout


def main(names: list[str]) -> None:
    """Replace the output of the examples that are named, or of all that the page shows."""
    page = PAGE.read_text(encoding="utf-8")
    shown = re.findall(r"`python examples/(\w+)\.py`", page)
    for name in [name for name in shown if name in (names or shown)]:
        print(name, flush=True)
        output = run(name)
        place = re.compile(
            rf"(^\[`python examples/{name}\.py`\]\(.*?\)\n\n```text\n).*?(^```)", re.DOTALL | re.MULTILINE
        )
        page, found = place.subn(lambda match, output=output: match[1] + output + match[2], page)
        if not found:
            raise SystemExit(f"{PAGE.name} has no block for the output of {name} after its command")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

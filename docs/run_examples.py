"""Run examples and put what they print into `docs/guides/examples.md`.

    python docs/run_examples.py              # all of them
    python docs/run_examples.py 09_seeing    # some

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
    """Replace the output of each example that the page shows."""
    page = PAGE.read_text(encoding="utf-8")
    for name in names or re.findall(r"^<!-- code of examples/(\w+)\.py -->$", page, re.MULTILINE):
        print(name, flush=True)
        place = re.compile(rf"(<!-- code of examples/{name}\.py -->\n\n```text\n)(.*?)(```)", re.DOTALL)
        output = run(name)
        page = place.sub(lambda match, output=output: match[1] + output + match[3], page)
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

"""The compiled core's tests under address and undefined-behaviour sanitizers: `make core-check`.

A copy of the package gets a core that was built with them; whatever reads outside, overflows or divides by zero among
integers ends the run. Every allocation of Python is the system's, so that those of arrays are watched as well.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import hatch_build

ROOT = Path(__file__).parents[1]
FLAGS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1"]
#: What peers and Python do with their own memory is not ours: EAIK deletes an object by another size.
OPTIONS = "detect_leaks=0:abort_on_error=1:new_delete_type_mismatch=0:alloc_dealloc_mismatch=0"
TESTS = [
    f"tests/kinematics/test_{name}.py"
    for name in ("core_faults", "core_elimination", "general_6r", "singular_cases", "five_axis")
]


def main(argv: list[str]) -> int:
    """Run the tests; arguments go to pytest, apart from the number of random and degenerate arms."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=20_000, help="default: %(default)s")
    options, arguments = parser.parse_known_args(argv)
    compiler = hatch_build.compiler()
    if compiler is None or "ziglang" in compiler:
        print("the sanitizers come with gcc or clang", file=sys.stderr)
        return 2
    # libstdc++ beside it: Pinocchio throws
    preloaded = [
        subprocess.run(
            [*compiler, f"-print-file-name={name}"], capture_output=True, text=True, check=True
        ).stdout.strip()
        for name in ("libasan.so", "libstdc++.so.6")
    ]
    with tempfile.TemporaryDirectory() as folder:
        ignored = shutil.ignore_patterns("__pycache__")
        for name in ("kinreach", "tests", "benchmarks", "tools"):
            shutil.copytree(ROOT / name, Path(folder) / name, ignore=ignored)
        shutil.copy(ROOT / "pyproject.toml", folder)
        place = Path(folder) / hatch_build.library().relative_to(ROOT)
        flags = [flag for flag in hatch_build.FLAGS if flag not in ("-O3", "-g0")]
        hatch_build.build(to=place, flags=[*flags, *FLAGS])
        watched = {
            "LD_PRELOAD": " ".join(preloaded), "ASAN_OPTIONS": OPTIONS,
            "PYTHONMALLOC": "malloc", "PYTHONPATH": folder, "OMP_NUM_THREADS": "1",
            "KINREACH_SANITIZED": str(options.arms),
        }  # fmt: skip
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:xdist", "-p", "no:cacheprovider", *TESTS, *arguments]
        return subprocess.run(command, cwd=folder, env={**os.environ, **watched}).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

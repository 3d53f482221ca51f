"""Wheels for Linux and macOS, x86-64 and ARM, made on this machine and checked: `make wheels`.

Each has one library for its machine, with every function of `core.h` and none that asks for a newer glibc than its tag
says.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import hatch_build

ROOT = Path(__file__).parents[1]
#: How a library for a machine begins: ELF's and Mach-O's magic number, and where and what names the processor.
MACHINES = {
    "x86_64-linux": (b"\x7fELF", 18, b"\x3e\x00"),
    "aarch64-linux": (b"\x7fELF", 18, b"\xb7\x00"),
    "x86_64-macos": (b"\xcf\xfa\xed\xfe", 4, b"\x07\x00\x00\x01"),
    "aarch64-macos": (b"\xcf\xfa\xed\xfe", 4, b"\x0c\x00\x00\x01"),
}
#: The newest symbols of glibc that manylinux2014 has.
NEWEST = (2, 17)


def functions() -> list[str]:
    """Return the functions that `core.h` declares."""
    return re.findall(r"\b(kr_\w+)\(", re.sub(r"/\*.*?\*/", "", (hatch_build.CORE / "core.h").read_text(), flags=re.S))


def faults(wheel: Path, target: str) -> list[str]:
    """Return what is wrong with a wheel."""
    with zipfile.ZipFile(wheel) as content:
        names = [name for name in content.namelist() if re.search(r"_core/core\.(so|dylib)$", name)]
        if len(names) != 1 or Path(names[0]).name != hatch_build.library(target).name:
            return [f"libraries {names}"]
        code = content.read(names[0])
    found = []
    magic, at, processor = MACHINES["-".join(re.split(r"[-.]", target)[:2])]
    if not code.startswith(magic) or code[at : at + len(processor)] != processor:
        found.append(f"the library is not for {target}")
    found += [f"{name} is missing" for name in functions() if name.encode() + b"\0" not in code]
    for version in sorted(set(re.findall(rb"GLIBC_(\d+)\.(\d+)", code))):
        if tuple(map(int, version)) > NEWEST:
            found.append(f"asks for glibc {b'.'.join(version).decode()}")
    return found


def main(argv: list[str] | None = None) -> int:
    """Make and check the wheels; return how many are faulty."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument("--target", choices=hatch_build.TARGETS, action="append", help="default: all")
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    faulty = 0
    for target in options.target or hatch_build.TARGETS:
        command = [
            sys.executable,
            "-m",
            "pip",
            "wheel",
            "--quiet",
            "--no-deps",
            "--wheel-dir",
            str(options.out),
            str(ROOT),
        ]
        subprocess.run(command, check=True, env={**os.environ, hatch_build.TARGET: target})
        (wheel,) = options.out.glob(f"kinreach-*-{hatch_build.TARGETS[target]}.whl")
        wrong = faults(wheel, target)
        faulty += bool(wrong)
        print(f"{wheel}: {'; '.join(wrong) or 'right'}", flush=True)
    return faulty


if __name__ == "__main__":
    sys.exit(main())

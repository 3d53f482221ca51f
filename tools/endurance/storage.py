"""Disks that are full or read-only: one line says so, and what was there before stays as it was."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tools.endurance.outcome import Outcome, demand

#: The jobs that write, without `--out DIR`.
COMMANDS = {
    "train": ("kinreach.train", "ppo-single", "--steps", "6000"),
    "compare": ("kinreach.compare", "--goals", "3", "--methods", "closed-form,lm"),
}
#: Free space on the full disks [KiB]: from nothing to almost enough.
SIZES = (0, 4, 8, 16, 40, 80, 160)
#: Exit code of kinreach for an error it understands.
REFUSED = 2
#: A small file system of this process alone; it is gone with the process, however that ends.
_SCRIPT = """
mount -t tmpfs -o size="$2"k,mode=755 tmpfs "$1" || exit 99
cp -a "$3"/. "$1" && mkdir -p "$1/full" || exit 98
free=$(df --output=avail -k "$1" | tail -1)
if [ "$4" = ro ]; then mount -o remount,bind,ro "$1" || exit 99
elif [ "$free" -gt "$4" ]; then head -c $(( (free - $4) * 1024 )) /dev/zero > "$1/ballast" || exit 98
fi
shift 4; out="$1"; shift
"$@"; code=$?
rm -f "$DISK/ballast" 2>/dev/null
cp -a "$DISK"/. "$out"; exit $code
"""


def can_mount() -> bool:
    """Whether this process may have file systems of its own."""
    tool = shutil.which("unshare")
    return tool is not None and _in_namespace("mount -t tmpfs tmpfs /mnt").returncode == 0


def full_disks(folder: Path, *, jobs: Sequence[str] = tuple(COMMANDS), sizes: Sequence[int] = SIZES) -> Outcome:
    """Run jobs on disks with little free space, and a read-only one, on which earlier results lie.

    Args:
        folder: An empty one.
        jobs: Keys of `COMMANDS`.
        sizes: Free space [KiB].

    Returns:
        No cases where nothing can be mounted.

    Raises:
        BrokenPromiseError: A job says more or less than one line, says it worked where it did not, or has spoiled
            what was there.
    """
    if not can_mount():
        return Outcome(0, "disks", "no file systems can be mounted here")
    earlier = folder / "earlier"
    for job in jobs:
        done = subprocess.run(_command(job, earlier / job), capture_output=True, text=True, check=False)
        demand(done.returncode == 0, f"{job} does not work at all: {done.stderr}")
    before = _contents(earlier)
    refused = 0
    for job in jobs:
        for free in [*map(str, sizes), "ro"]:
            refused += _on_a_disk(job, folder, earlier, before, free)
    return Outcome(len(jobs) * (len(sizes) + 1), "disks", f"{refused} refused in one line; {len(before)} files intact")


def _on_a_disk(job: str, folder: Path, earlier: Path, before: dict[str, str], free: str) -> bool:
    """Run one job on one disk; whether it was refused."""
    disk, after = folder / "disk", folder / f"after-{job}-{free}"
    for each in (disk, after):
        each.mkdir(exist_ok=True)
    size = 4 * sum(path.stat().st_size for path in earlier.rglob("*") if path.is_file()) // 1024 + 1024
    done = _in_namespace(
        _SCRIPT, str(disk), str(size), str(earlier), free, str(after), *_command(job, disk / "full"), DISK=str(disk)
    )
    where = f"{job} with {free} {'' if free == 'ro' else 'KiB free'}"
    demand(done.returncode in (0, REFUSED), f"{where}: exit code {done.returncode}, {done.stderr[-2000:]}")
    found = _contents(after)
    demand({name: found.get(name) for name in before} == before, f"{where}: earlier results are not what they were")
    left = [name for name in found if Path(name).name.startswith(".")]
    demand(not left, f"{where}: {left} left behind")
    if done.returncode == 0:
        return False
    lines = done.stderr.strip().splitlines()
    demand(len(lines) == 1 and "cannot write" in lines[0], f"{where}: not one clear line: {done.stderr[-2000:]}")
    return True


def _command(job: str, out: Path) -> list[str]:
    module, *options = COMMANDS[job]
    return [sys.executable, "-m", module, *options, "--out", str(out)]


def _in_namespace(script: str, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = ["unshare", "--map-root-user", "--mount", "sh", "-c", script, "sh", *arguments]
    environment = {**os.environ, **variables}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=1200)


def _contents(folder: Path) -> dict[str, str]:
    """Digests of all files by their names."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }

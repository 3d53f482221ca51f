"""Build of the compiled core: `kinreach/kinematics/_core/*.c` into one library without Python's headers.

pip calls it through hatchling. `python hatch_build.py` builds it in place, in some seconds, after the C code was
changed; `CC` names another compiler. Where the machine has none, pip brings one from the package index (ziglang).
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

CORE = Path(__file__).resolve().parent / "kinreach/kinematics/_core"
#: One C99 source, strictly: the same bits for one posture as for many, whatever the compiler would like to reorder.
FLAGS = [
    "-std=c99", "-O3", "-g0", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off", "-fno-math-errno",
    "-fno-trapping-math", "-Wall", "-Wextra", "-Wpedantic", "-Werror=implicit-function-declaration",
]  # fmt: skip
#: Where the wheels of other machines run: the compiler's target, and the wheel's platform.
TARGETS = {
    "x86_64-linux-gnu.2.17": "manylinux_2_17_x86_64.manylinux2014_x86_64",
    "aarch64-linux-gnu.2.17": "manylinux_2_17_aarch64.manylinux2014_aarch64",
    "x86_64-macos.11.0": "macosx_11_0_x86_64",
    "aarch64-macos.11.0": "macosx_11_0_arm64",
}
#: In the environment: the target of a wheel for another machine.
TARGET = "KINREACH_TARGET"


def library(target: str = "") -> Path:
    """Where the core is, for this machine or for a target."""
    darwin = "macos" in target if target else sys.platform == "darwin"
    return CORE / ("core.dylib" if darwin else "core.so")


def compiler(target: str = "") -> list[str] | None:
    """Return the command of a C compiler, or None where there is none."""
    zig = [sys.executable, "-m", "ziglang", "cc"]
    if target:
        return [*zig, "-target", target]
    if named := os.environ.get("CC"):
        return shlex.split(named)
    for name in (*shlex.split(sysconfig.get_config_var("CC") or "")[:1], "cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    try:
        import ziglang  # noqa: F401
    except ImportError:
        return None
    return zig


def build(target: str = "", *, to: Path | None = None, flags: list[str] = FLAGS) -> Path:
    """Compile the core, for this machine or for a target; the library is replaced when the new one is whole."""
    command, out = compiler(target), to or library(target)
    if command is None:
        sys.exit("kinreach's core needs a C compiler: install gcc or clang, or `pip install ziglang`")
    sources = sorted(str(source) for source in CORE.glob("*.c"))
    with tempfile.TemporaryDirectory(dir=out.parent) as folder:
        made = Path(folder) / out.name
        run = subprocess.run([*command, *flags, *sources, "-o", str(made), "-lm"], capture_output=True, text=True)
        if run.returncode:
            sys.exit(f"kinreach's core does not compile with {shlex.join(command)}:\n{run.stderr.strip()[-2000:]}")
        if run.stderr:
            print(run.stderr, file=sys.stderr)
        made.replace(out)
    return out


try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:
    pass  # built in place
else:

    class CoreBuildHook(BuildHookInterface):  # type: ignore[type-arg]
        """Compiles the core for the wheel, or in place for an editable installation."""

        PLUGIN_NAME = "custom"

        def dependencies(self) -> list[str]:
            """Return what the build needs besides hatchling: a compiler, where the machine has none."""
            return ["ziglang>=0.13"] if os.environ.get(TARGET) or compiler() is None else []

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            """Compile, in place for an editable installation, and name the platform in the wheel's tag."""
            target = os.environ.get(TARGET, "")
            platform = TARGETS[target] if target else sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{platform}"
            if version == "editable":
                build()
                return
            self._folder = tempfile.TemporaryDirectory()
            place = library(target)
            made = build(target, to=Path(self._folder.name) / place.name)
            build_data["force_include"][str(made)] = str(place.relative_to(self.root))

        def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
            """Remove what is in the wheel now."""
            if version != "editable":
                self._folder.cleanup()


if __name__ == "__main__":
    print(build(os.environ.get(TARGET, "")))

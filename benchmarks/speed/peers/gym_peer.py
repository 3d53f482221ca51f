"""Other people's Gymnasium environments, each in a process of its own, where their versions may differ from ours."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from types import TracebackType
from typing import Any

from kinreach.errors import InstallationError

#: Longest that a peer may take to start, and to answer [s].
START, ANSWER = 120.0, 600.0
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class PeerEnvironment:
    """An environment of another package.

    Attributes:
        name: Its id.
        module: Whose import registers it.
        packages: Distributions whose versions are told.
        variable: Environment variable that names a Python with these packages; kinreach's own without it.
    """

    name: str
    module: str
    packages: tuple[str, ...]
    variable: str


PANDA = PeerEnvironment("PandaReach-v3", "panda_gym", ("panda-gym", "pybullet"), "KINREACH_BENCH_PYTHON_PANDA_GYM")
PANDA_PUSH, PANDA_PICK = (replace(PANDA, name=f"Panda{task}-v3") for task in ("Push", "PickAndPlace"))
#: gymnasium-robotics 1.4.2 runs with MuJoCo before 3.4, thus in a Python of its own.
FETCH = PeerEnvironment(
    "FetchReach-v4", "gymnasium_robotics", ("gymnasium-robotics", "mujoco"), "KINREACH_BENCH_PYTHON_FETCH"
)
FETCH_PICK = replace(FETCH, name="FetchPickAndPlace-v4")
REACHER = PeerEnvironment("Reacher-v5", "mujoco", ("gymnasium", "mujoco"), "KINREACH_BENCH_PYTHON_REACHER")


class GymPeer:
    """A peer's environment in its process, on one thread; to be closed, or used as a context manager.

    Args:
        environment: Which.
        seed: Of its episodes and actions.
        start: Longest that it may take to start [s].

    Attributes:
        description: Versions of its packages, in words.

    Raises:
        InstallationError: It does not start; the message says why.
    """

    def __init__(self, environment: PeerEnvironment, *, seed: int = 0, start: float = START) -> None:
        python = os.environ.get(environment.variable)
        setup = {
            "name": environment.name,
            "module": environment.module,
            "packages": environment.packages,
            "seed": seed,
        }
        surroundings = {**os.environ, **dict.fromkeys(_THREADS, "1")}
        if python is not None:
            surroundings.pop("PYTHONPATH", None)  # it leads to packages of kinreach's Python
        source = (resources.files("benchmarks.speed.peers") / "gym_child.py").read_text(encoding="utf-8")
        self._name = environment.name
        self._said: Any = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the peer)
        self._unread = b""
        try:
            self._process: Any = subprocess.Popen(
                [python or sys.executable, "-c", source, json.dumps(setup)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                env=surroundings,
            )
        except OSError as error:
            self._said.close()
            raise InstallationError(f"{environment.variable}={python}: {error.strerror or error}") from error
        try:
            hello = self._answer(start)
        except BaseException:
            self.close()
            raise
        versions = ", ".join(f"{name} {version}" for name, version in hello["versions"].items())
        self.description = f"{versions}, Python {hello['python']}"

    def play(self, steps: int) -> float:
        """Step it under random actions, with resets where episodes end.

        Returns:
            The time that it took, by its own clock [s].

        Raises:
            InstallationError: It does not.
        """
        return float(self._ask({"play": steps})["wall"])

    def ppo(self, steps: int, envs: int, settings: dict[str, Any]) -> dict[str, float]:
        """Train PPO on several of them; see `gym_child.learning_seconds`.

        Args:
            steps: Actions.
            envs: Environments, one after the other in its process.
            settings: Keyword arguments of stable-baselines3's `PPO`, as JSON knows them.

        Raises:
            InstallationError: It does not, or has no stable-baselines3.
        """
        return self._ask({"ppo": {"steps": steps, "envs": envs, "settings": settings}})

    def close(self) -> None:
        """End the process of the peer."""
        for pipe in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):  # it may have gone already
                pipe.close()
        self._process.kill()
        self._process.wait()
        self._said.close()

    def __enter__(self) -> GymPeer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        with contextlib.suppress(OSError):  # it has ended: `_answer` says so
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
            self._process.stdin.flush()
        return self._answer(ANSWER)

    def _answer(self, longest: float) -> dict[str, Any]:
        end = time.monotonic() + longest
        while b"\n" not in self._unread:
            readable, _, _ = select.select([self._process.stdout], [], [], max(end - time.monotonic(), 0.0))
            if not readable:
                raise InstallationError(f"{self._name} does not answer for {longest:g} s")
            part = os.read(self._process.stdout.fileno(), 65536)
            if not part:
                raise InstallationError(f"the process of {self._name} ended: {self._last_words()}")
            self._unread += part
        line, _, self._unread = self._unread.partition(b"\n")
        try:
            answer = json.loads(line)
        except ValueError:
            raise InstallationError(f"{self._name} answers {line[:80]!r}") from None
        if "error" in answer:
            raise InstallationError(str(answer["error"]))
        return dict(answer)

    def _last_words(self) -> str:
        self._process.wait()
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), f"exit {self._process.returncode}")


@contextlib.contextmanager
def gym_peers(
    environments: Sequence[PeerEnvironment], *, seed: int = 0
) -> Iterator[tuple[dict[str, GymPeer], dict[str, str]]]:
    """Start peers, and end them afterwards.

    Yields:
        Name -> peer, and name -> why it is missing.
    """
    peers: dict[str, GymPeer] = {}
    missing: dict[str, str] = {}
    with contextlib.ExitStack() as stack:
        for environment in environments:
            try:
                peers[environment.name] = stack.enter_context(GymPeer(environment, seed=seed))
            except InstallationError as error:
                missing[environment.name] = " ".join(str(error).split())
        yield peers, missing

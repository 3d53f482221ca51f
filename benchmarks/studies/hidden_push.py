"""A cube that is pushed where no camera sees it: a script, the script with a simulation of its own, and a network.

    python -m kinreach.train benchmarks.learners:imitated_hidden_push --seeds 5
    python -m benchmarks.studies.hidden_push results/train/imitated-hidden-push

All methods believe a friction of 1, with which the network was trained. `script` goes by what it observes; `told` sees
all, as with a perfect view. `simulated` is the script with a simulation of the arm and the cube: it repeats every
action there, puts the cube where it is seen, and goes by the simulated cube where it is not.
Finished cells are kept in `--out`: an interrupted study goes on.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.learners.hidden_push import ID, OBJECT, WORLD
from benchmarks.logs import policies_in
from benchmarks.studies.parts import counted, kept
from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import with_interval
from kinreach import _provenance as provenance
from kinreach._checks import Floats, check_count
from kinreach._files import make_writable
from kinreach.baselines import evaluate, load_policy, rollout
from kinreach.baselines.inside import PushScript
from kinreach.cli import Parser, finish
from kinreach.errors import InputError

PROG = "python -m benchmarks.studies.hidden_push"
#: True coefficients of friction.
FRICTIONS = (1.0, 0.5, 0.25)
#: Of the first episode; the network's trainings draw others.
SEED = 5252
#: A goal of the simulated cube that it never comes to [m]: an episode that is simulated does not end.
NOWHERE = (0.5, 0.0, 1.0)


class Told(PushScript):
    """The script, which is told where the object is."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        made: Any = env.unwrapped
        self._episodes = made.episodes

    def act(self, observation: Any) -> Floats:
        """Return the next action."""
        return super().act(self._episodes.whole()[0])


class Simulated(PushScript):
    """The script, which goes by a simulation of its own where it does not see the object."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self._model: Any = gym.make(ID, strip=0.0, dtype="float64", max_episode_steps=10**6).unwrapped
        (joint,) = np.flatnonzero(self._model.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[-1:]
        first = int(self._model.model.jnt_qposadr[joint])
        self._place, self._turn = slice(first, first + 3), slice(first + 3, first + 7)

    def reset(self, observation: Floats, info: Mapping[str, Any]) -> None:
        """Put the simulated object where it is seen."""
        self._last = np.array(observation[OBJECT])
        yaw = math.atan2(self._last[5], self._last[3])
        options = {"place": self._last[:2], "yaw": [yaw], "goal": NOWHERE}
        self._now, _ = self._model.reset(options=options)

    def act(self, observation: Any) -> Floats:
        """Return the next action, which is simulated, too."""
        known = np.array(observation, dtype=float)
        if np.array_equal(known[OBJECT], self._last):
            known[OBJECT] = self._now[OBJECT]
        else:
            self._last = np.array(known[OBJECT])
            columns = self._last[3:].reshape(3, 2)
            R = np.column_stack([columns, np.cross(*columns.T)])
            self._model.data.qpos[self._place] = self._last[:3]
            self._model.data.qpos[self._turn] = Rotation.from_matrix(R).as_quat(scalar_first=True)
        action = super().act(known)
        self._now, *_ = self._model.step(action)
        return action


#: What needs no training, and what does.
METHODS, LEARNED = {"script": PushScript, "simulated": Simulated, "told": Told}, "imitated-hidden-push"


def pushed(method: str, file: Path | None, friction: float, *, episodes: int, seed: int, out: Path) -> list[bool]:
    """Return in which episodes a method, or the policy in a file, brings the object to its goal."""

    def played() -> list[bool]:
        if file is not None:
            policy = load_policy(file)
            found = evaluate(policy, goals=episodes, seed=seed, environment=WORLD, options={"friction": friction})
            return [bool(reached) for reached in found.reached]
        with closing(gym.make(ID, friction=friction, dtype="float64")) as env:
            resets = ({"seed": seed + index} for index in range(episodes))
            return [bool(trial["reached"]) for trial in rollout(env, METHODS[method](env), resets)]

    policy = "" if file is None else provenance.digest(file.read_bytes())
    return kept(
        out, {"method": method, "file": policy, "friction": friction, "episodes": episodes, "seed": seed}, played
    )


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trainings", type=Path, help="folder of the trainings of imitated-hidden-push")
    parser.add_argument("--frictions", type=float, nargs="+", default=FRICTIONS, help="(default: %(default)s)")
    parser.add_argument("--episodes", type=int, default=200, help="(default: %(default)s)")
    parser.add_argument("--seed", type=int, default=SEED, help="of the first episode (default: %(default)s)")
    parser.add_argument(
        "--out", type=Path, default=Path("results/hidden-push"), help="where finished cells are kept (%(default)s)"
    )
    given = parser.parse_args(argv)
    tried = {"episodes": check_count("--episodes", given.episodes), "seed": check_count("--seed", given.seed, least=0)}
    policies = policies_in(given.trainings)
    if not policies:
        raise InputError(f"{given.trainings} has no finished trainings, seed-0/policy.safetensors and others")
    make_writable(given.out)
    tried["out"] = given.out
    print(head("method", *(f"friction {friction:g}" for friction in given.frictions)))
    rows: dict[str, list[np.ndarray]] = {}
    with counted(len(given.frictions) * (len(METHODS) + len(policies))) as done:
        for method in (*METHODS, LEARNED):
            for friction in given.frictions:
                found = []
                for file in policies if method == LEARNED else [None]:
                    found.append(pushed(method, file, friction, **tried))
                    done()
                rows.setdefault(method, []).append(np.array(found))
            print(line(f"`{method}`", *(with_interval(row, unit=100, decimals=1) for row in rows[method])), flush=True)
    print(f"\nCubes brought to their goals, in %, of {given.episodes} (seed {given.seed}), with 95 % intervals.")
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

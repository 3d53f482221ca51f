"""Register the environments with Gymnasium, which is not imported for that.

Gymnasium 1.x reads no plugin entry points: `import kinreach` before `gym.make`, or have Gymnasium do it, in worker
processes too, by naming the module in the id, `gym.make("kinreach:kinreach/UR5SingleStep-v0")`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

_REACH, _BUTTON = "kinreach.envs._reach", "kinreach.envs._button"
#: Ids of the environments.
SINGLE, MULTI, BUTTON = "kinreach/UR5SingleStep-v0", "kinreach/UR5MultiStep-v0", "kinreach/ButtonPress-v0"
SPACE = "kinreach/Reach-v0"
REAL_ARM, MOVING, OBSTACLES = "kinreach/RealArm-v0", "kinreach/Moving-v0", "kinreach/Obstacles-v0"
RANDOM_ARM, LIFT = "kinreach/RandomArm-v0", "kinreach/Lift-v0"
PUSH, PICK_AND_PLACE = "kinreach/Push-v0", "kinreach/PickAndPlace-v0"
#: Those of the reach tasks without dynamics, with numbers only in `info`: for clients that cannot pass
#: `backend="kinematic"` on, or cannot read texts.
SINGLE_KINEMATIC, MULTI_KINEMATIC = "kinreach/UR5SingleStepKinematic-v0", "kinreach/UR5MultiStepKinematic-v0"

_SINGLE = (f"{_REACH}.env:UR5SingleStepEnv", f"{_REACH}.vector_env:SingleStepVectorEnv")
_MULTI = (f"{_REACH}.env:UR5MultiStepEnv", f"{_REACH}.vector_env:MultiStepVectorEnv")
_TABLETOP = ("kinreach.envs._tabletop:TabletopEnv", "kinreach.envs._tabletop:TabletopVectorEnv")
#: Environment id -> entry points of the single environment and of its native batch.
ENVIRONMENTS = {
    SINGLE: _SINGLE,
    MULTI: _MULTI,
    SPACE: (f"{_REACH}.env:SpaceReachEnv", f"{_REACH}.vector_env:SpaceReachVectorEnv"),
    BUTTON: (f"{_BUTTON}.env:ButtonPressEnv", f"{_BUTTON}.env:ButtonPressVectorEnv"),
    MOVING: ("kinreach.envs.moving:MovingBallEnv", "kinreach.envs.moving:MovingVectorEnv"),
    LIFT: ("kinreach.envs._lift.env:LiftEnv", "kinreach.envs._lift.env:LiftVectorEnv"),
    REAL_ARM: ("kinreach.envs.real_arm:RealArmEnv", "kinreach.envs.real_arm:RealArmVectorEnv"),
    OBSTACLES: ("kinreach.envs._obstacles:ObstaclesEnv", "kinreach.envs._obstacles:ObstaclesVectorEnv"),
    PUSH: _TABLETOP,
    PICK_AND_PLACE: _TABLETOP,
}
#: Environment id -> class of its `TabletopTask`.
TABLETOP_TASKS = {
    PUSH: "kinreach.envs._tabletop_tasks:Push",
    PICK_AND_PLACE: "kinreach.envs._tabletop_tasks:PickAndPlace",
}
#: Environment id -> the same, with `backend="kinematic"` and `info="numbers"`.
KINEMATIC_ENVIRONMENTS = {SINGLE_KINEMATIC: _SINGLE, MULTI_KINEMATIC: _MULTI}
#: As `ENVIRONMENTS`, only for training: nothing is drawn of them.
TRAINING_ENVIRONMENTS = {
    RANDOM_ARM: (
        "kinreach.baselines.random_arms:RandomArmEnv",
        "kinreach.baselines.random_arms:RandomArmVectorEnv",
    ),
}
#: Environment id -> steps after which Gymnasium truncates an episode, unless `max_episode_steps` says otherwise. Where
#: a task ends its episodes itself, they are shorter: an end is then not a truncation, too.
MAX_EPISODE_STEPS = {
    **dict.fromkeys((SINGLE, MULTI, SPACE, SINGLE_KINEMATIC, MULTI_KINEMATIC, MOVING, RANDOM_ARM, OBSTACLES), 100),
    LIFT: 150,
    **dict.fromkeys((REAL_ARM, PUSH, PICK_AND_PLACE), 200),
    BUTTON: 1000,
}


def register_environments() -> None:
    """Register every environment, now or as soon as Gymnasium is imported: kinematics alone does not wait for it."""
    if "gymnasium" in sys.modules:
        _register()
    else:
        sys.meta_path.insert(0, _RegisterAfterImport())


class _RegisterAfterImport(MetaPathFinder):
    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        spec = next((found for finder in others if (found := finder.find_spec(name, path, target))), None)
        loader: Any = spec and spec.loader
        if loader:
            load = loader.exec_module

            def load_and_register(module: ModuleType) -> None:
                load(module)
                _register()

            loader.exec_module = load_and_register
        return spec


def _register() -> None:
    from gymnasium.envs.registration import register, registry

    plain = {"backend": "kinematic", "info": "numbers"}
    for environments, options in (
        (ENVIRONMENTS, {}),
        (KINEMATIC_ENVIRONMENTS, plain),
        (TRAINING_ENVIRONMENTS, {}),
    ):
        for name, (entry_point, vector_entry_point) in environments.items():
            if name not in registry:
                register(
                    name,
                    entry_point=entry_point,
                    vector_entry_point=vector_entry_point,
                    max_episode_steps=MAX_EPISODE_STEPS[name],
                    kwargs={"task": TABLETOP_TASKS[name], "limit": MAX_EPISODE_STEPS[name]}
                    if name in TABLETOP_TASKS
                    else options,
                )

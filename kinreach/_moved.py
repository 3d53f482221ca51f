"""Names of version 0.1.0 that have moved: they go on importing from where they were, with a `DeprecationWarning`.

`MODULES` says where the names of a module are now, `NAMES` where a single name is that was renamed or went elsewhere.
An old module is not a file: a finder on `sys.meta_path`, put there by `import kinreach`, makes it when it is imported,
and loads nothing before. The old names go with version 1.0.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

#: Module of 0.1.0 -> where its names are now; for a module that is still there, those that it has no more.
MODULES = {
    "kinreach.kinematics.goals": "kinreach.checks",
    "kinreach.inputs": "kinreach.checks",
    "kinreach.robots.urdf_check": "kinreach.robots.urdf",
    "kinreach.robots.arms.ur5": "kinreach.robots.ur",
    "kinreach.robots.arms.arm3": "kinreach.robots.arm3",
    "kinreach.kinematics.result": "kinreach.kinematics.solutions",
    "kinreach.kinematics.ur5": "kinreach.kinematics.ur.kinematics",
    "kinreach.kinematics.ur_geometry": "kinreach.kinematics.ur.geometry",
    "kinreach.kinematics.ur_flags": "kinreach.kinematics.ur.geometry",
    "kinreach.kinematics.ur_ik": "kinreach.kinematics.ur.closed_form",
    "kinreach.kinematics.ur_batch": "kinreach.kinematics.ur.batch",
    "kinreach.kinematics.arm3_ik": "kinreach.kinematics.arm3",
    "kinreach.kinematics.arm3_batch": "kinreach.kinematics.arm3",
    "kinreach.kinematics.rounded_boxes": "kinreach.kinematics.bodies",
    "kinreach.kinematics.box_overlap": "kinreach.kinematics.bodies",
    "kinreach.kinematics.cell_shapes": "kinreach.kinematics.collision",
    "kinreach.kinematics.solvers.closed_form": "kinreach.kinematics.solvers.base",
    "kinreach.kinematics.solvers.goal_task": "kinreach.kinematics.solvers.iterative",
    "kinreach.kinematics.solvers.joint_space": "kinreach.kinematics.solvers.iterative",
    "kinreach.kinematics.posture_geometry": "kinreach.thesis.posture",
    "kinreach.kinematics.reward_geometry": "kinreach.thesis.reward",
    "kinreach.envs.engine": "kinreach.sim.engine",
    "kinreach.envs.looks": "kinreach.sim.looks",
    "kinreach.envs.cameras": "kinreach.sim.looks",
    "kinreach.envs.meshes": "kinreach.sim.looks",
    "kinreach.envs.scene": "kinreach.sim.scene",
    "kinreach.envs.contacts": "kinreach.sim.controller",
    "kinreach.envs.moves": "kinreach.sim.controller",
    "kinreach.envs.following": "kinreach.sim.setpoints",
    "kinreach.envs.controller": "kinreach.sim.controller",
    "kinreach.envs.profile": "kinreach.sim.setpoints",
    "kinreach.envs.setpoints": "kinreach.sim.setpoints",
    "kinreach.envs.plants": "kinreach.sim.plants",
    "kinreach.envs.simulation": "kinreach.sim.simulation",
    "kinreach.envs.batch_simulation": "kinreach.sim.simulation",
    "kinreach.envs.rendering": "kinreach.sim.rendering",
    "kinreach.envs.viewer": "kinreach.sim.picture",
    "kinreach.envs.picture": "kinreach.sim.picture",
    "kinreach.envs.pinhole": "kinreach.vision.cameras",
    "kinreach.envs.rgbd": "kinreach.vision.cameras",
    "kinreach.envs.ball_finder_hough": "kinreach.vision.circles",
    "kinreach.envs.ball_finder": "kinreach.vision.ball_finder",
    "kinreach.envs.ball_finder_steps": "kinreach.vision.circles",
    "kinreach.envs.goal_view": "kinreach.vision.goal_view",
    "kinreach.envs.resets": "kinreach.envs.options",
    "kinreach.envs.streams": "kinreach.envs.batch",
    "kinreach.envs.native_batch": "kinreach.envs.batch",
    "kinreach.envs.reach.world": "kinreach.envs.reach.worlds",
    "kinreach.envs.reach.kinematic_world": "kinreach.envs.reach.worlds",
    "kinreach.envs.reach.dynamic_world": "kinreach.envs.reach.worlds",
    "kinreach.envs.reach.single_step": "kinreach.envs.reach.env",
    "kinreach.envs.reach.multi_step": "kinreach.envs.reach.env",
    "kinreach.envs.reach.options": "kinreach.envs.reach.task",
    "kinreach.envs.reach.pixels": "kinreach.envs.reach.observers",
    "kinreach.envs.button.actuation": "kinreach.envs.button.task",
    "kinreach.envs.button.scene": "kinreach.envs.button.world",
    "kinreach.envs.button.options": "kinreach.envs.button.episodes",
    "kinreach.envs.button.starts": "kinreach.envs.button.episodes",
    "kinreach.baselines.network": "kinreach.baselines.policies",
    "kinreach.baselines.policy_file": "kinreach.baselines.policies",
    "kinreach.baselines.pacing": "kinreach.baselines.policies",
    "kinreach.baselines.learned": "kinreach.baselines.policies",
    "kinreach.baselines.scripted": "kinreach.baselines.rollout",
    "kinreach.baselines.evaluation_table": "kinreach.baselines.evaluation",
    "kinreach.baselines.sb3_networks": "kinreach.baselines.networks",
    "kinreach.baselines.ranked_ppo": "kinreach.baselines.algorithms",
    "kinreach.baselines.export": "kinreach.baselines.networks",
    "kinreach.baselines.button_reward": "kinreach.baselines.rewards",
    "kinreach.baselines.training_reward": "kinreach.baselines.rewards",
    "kinreach.baselines.sb3_vec_env": "kinreach.baselines.vec_envs",
    "kinreach.baselines.tries_vec_env": "kinreach.baselines.vec_envs",
    "kinreach.baselines.run_folder": "kinreach.baselines.training",
    "kinreach.baselines.checkpoint": "kinreach.baselines.training",
    "kinreach.baselines.traces": "kinreach.baselines.logs",
    "kinreach.plots.paths": "kinreach.plots.maps",
    "kinreach.plots.optimum": "kinreach.plots.methods",
}
#: Name of 0.1.0 with its module -> the same now, where it was renamed or went elsewhere than its module.
NAMES = {
    "kinreach.baselines.button_controller.TURN": "kinreach.kinematics.angles.TURN",
    "kinreach.baselines.evaluation.TOLERANCES_MM": "kinreach.summary.TOLERANCES_MM",
    "kinreach.baselines.export.network_of": "kinreach.baselines.networks.actor_network",
    "kinreach.baselines.models.BUTTON_SCALE": "kinreach.baselines.algorithms.BUTTON_SCALE",
    "kinreach.baselines.run_folder.finished_run": "kinreach.baselines.training.kept_run",
    "kinreach.baselines.run_folder.remove": "kinreach.baselines.training._remove",
    "kinreach.baselines.scripted.AnalyticReachPolicy": "kinreach.baselines.solver_policy.AnalyticReachPolicy",
    "kinreach.demo.cli.FILM_FPS": "kinreach.demo.film.FILM_FPS",
    "kinreach.envs.reach.UR5ReachVectorEnv": "kinreach.envs.reach.ReachVectorEnv",
    "kinreach.envs.reach.env.UR5ReachEnv": "kinreach.envs.reach.env.ReachEnv",
    "kinreach.envs.reach.options.OBSERVATIONS": "kinreach.envs.reach.task.OBSERVATION_KINDS",
    "kinreach.envs.reach.vector_env.UR5ReachVectorEnv": "kinreach.envs.reach.vector_env.ReachVectorEnv",
    "kinreach.envs.ball_finder_steps.MOST_RADIUS": "kinreach.vision.circles.MOST_RADIUS_PIXELS",
    "kinreach.kinematics.arm3_ik.TURN": "kinreach.kinematics.angles.TURN",
    "kinreach.kinematics.cell_shapes.Part": "kinreach.kinematics.collision.Shape",
    "kinreach.kinematics.solvers.joint_space.TWO_PI": "kinreach.kinematics.angles.TURN",
    "kinreach.kinematics.solvers.base.Tolerance": "kinreach.kinematics.solutions.Tolerance",
    "kinreach.robots.description.Gripper": "kinreach.robots.grippers.Gripper",
    "kinreach.robots.arms.ur5.STROKE": "kinreach.robots.grippers.STROKE",
    "kinreach.robots.arms.ur5.TCP_OFFSET": "kinreach.robots.grippers.TCP_OFFSET",
}
#: Name of 0.1.0 with its module -> what it was, where that has no name any more.
VALUES: dict[str, Callable[[], Any]] = {
    "kinreach.robots.arms.ur5.ARM": lambda: importlib.import_module("kinreach.robots").get_arm("ur5"),
    "kinreach.robots.arms.ur5.TABLE_TOP": lambda: -0.20,
}
#: Packages that are gone, and had no names but their modules.
PACKAGES = frozenset({"kinreach.robots.arms"})
#: What was not kept, and what there is instead.
REMOVED = {"kinreach.bench": "`make bench` or `python -m benchmarks.speed` in a checkout (it is not in the package)"}


def install() -> None:
    """Let imports of old names find the new ones; once a process."""
    if not any(isinstance(finder, _OldNames) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OldNames())


def _find(module: str, name: str) -> tuple[str, Any]:
    """Where a name of 0.1.0 is now, and the object.

    Raises:
        AttributeError: There is no such name.
    """
    old = f"{module}.{name}"
    if old in VALUES:
        return MODULES[module], VALUES[old]()
    where = NAMES.get(old, f"{MODULES[module]}.{name}" if module in MODULES else "")
    place, _, new_name = where.rpartition(".")
    if place and not (name.startswith("__") and name.endswith("__")):
        found = vars(importlib.import_module(place))
        if new_name in found:
            return where, found[new_name]
    raise AttributeError(f"module {module!r} has no attribute {name!r}", name=name)


def _warn(old: str, new: str) -> None:
    """Warn the file that imports or reads an old name."""
    warnings.warn(f"{old} is now {new}", DeprecationWarning, stacklevel=3)


class _OldModule(ModuleType):
    """A module that is gone: its names are read where they are now."""

    def __getattr__(self, name: str) -> Any:
        return _find(self.__name__, name)[1]

    def __dir__(self) -> list[str]:
        return dir(importlib.import_module(MODULES[self.__name__])) if self.__name__ in MODULES else []


class _OldNames(MetaPathFinder, Loader):
    """Finds modules that are gone, and gives those that are still there the names that they had."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """How to load a module of which a name has moved; None for every other."""
        if name in REMOVED:
            raise ModuleNotFoundError(f"{name} is gone; instead: {REMOVED[name]}", name=name)
        if not (name in MODULES or name in PACKAGES or any(old.rpartition(".")[0] == name for old in NAMES)):
            return None
        present = PathFinder.find_spec(name, path, target)
        if present is None:
            return ModuleSpec(name, self, is_package=name in PACKAGES)
        present.loader.exec_module = _with_old_names(present.loader.exec_module)  # type: ignore[union-attr,method-assign]
        return present

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """An empty module that reads its names elsewhere."""
        return _OldModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Warn who imports it."""
        if module.__name__ in MODULES:
            _warn(module.__name__, MODULES[module.__name__])


def _with_old_names(execute: Callable[[ModuleType], None]) -> Callable[[ModuleType], None]:
    def exec_module(module: ModuleType) -> None:
        execute(module)
        own = module.__dict__.get("__getattr__")  # a package that loads its parts late

        def read(name: str) -> Any:
            try:
                where, found = _find(module.__name__, name)
            except AttributeError:
                if own is None:
                    raise
                return own(name)
            _warn(f"{module.__name__}.{name}", where)
            setattr(module, name, found)  # one warning
            return found

        module.__getattr__ = read  # type: ignore[method-assign]

    return exec_module

"""The setup of the page from the command line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from kinreach._objects import load_object
from kinreach._registration import MULTI, SINGLE
from kinreach.baselines import load_policy
from kinreach.demo.inside import playable, playable_names
from kinreach.robots import ArmDescription, Tool, arm_names, get_arm
from kinreach.robots.inside import FILES, ArmFlags
from kinreach.view._figure import Figure
from kinreach.view._motion import ShownMotion
from kinreach.view._results import read_results
from kinreach.view._snippet import calibrated, described, with_tool
from kinreach.view._target import TargetModel

#: The parts of the page.
TARGET, MOVE, REAL_ARM, EPISODES, RESULTS = "Target", "Move", "Real arm", "Episodes", "Results"


@dataclass(frozen=True)
class Setup:
    """The start of every tab.

    Attributes:
        arm: The arm, calibrated if a calibration was given.
        expression: The arm as Python code.
        sheet: The arm by its data sheet as Python code.
        simple: Draw the arm by its collision shapes, for browsers without a graphics card.
        nominal: The arm by its data sheet if `arm` is calibrated.
        policy: That acts in the first episode: its name or file, or `module:attribute`.
        environment: Id of the first environment, or `module:id`.
        words: The flags of the command line that choose the arm.
        motion: That the part "Move" begins with.
    """

    arm: ArmDescription
    expression: str
    sheet: str
    simple: bool = False
    nominal: ArmDescription | None = None
    calibration: str | None = None
    policy: str | None = None
    results: str | None = None
    environment: str | None = None
    words: tuple[str, ...] = ()
    motion: ShownMotion | None = None

    @property
    def title(self) -> str:
        return f"kinreach – {(self.nominal or self.arm).name}"

    @property
    def first(self) -> str:
        if self.motion is not None:
            return MOVE
        if self.results is not None:
            return RESULTS
        return TARGET if self.policy is None and self.environment is None else EPISODES

    def model(self) -> TargetModel:
        return TargetModel(self.arm, policies=self.policies)

    @property
    def policies(self) -> tuple[str, ...]:
        """Policies that bring the arm's own tip to a goal: those of the package and `policy`."""
        name = (self.nominal or self.arm).name
        if name in arm_names() and self.arm.default_tip != get_arm(name).default_tip:
            return ()
        found = [policy for environment in (SINGLE, MULTI) for policy in playable(environment).trained(name)]
        own = self.policy or ""
        fits = own and ":" not in own and self.policy_environment in ("", SINGLE, MULTI)
        return tuple(dict.fromkeys([*found, *([own] if fits else [])]))

    @cached_property
    def policy_environment(self) -> str:
        """Id of the environment of the policy; empty if there is none."""
        if self.policy is None:
            return ""
        if ":" in self.policy:
            load_object("policy", self.policy)
            return ""
        return load_policy(self.policy).card.environment

    @cached_property
    def environments(self) -> tuple[str, ...]:
        """Names of environments for `playable`, the wanted one first.

        For an arm without goals, only environments with an arm of their own.
        """
        wanted = self.policy_environment if self.environment is None else self.environment
        if wanted:
            playable(wanted)
        goals = self.arm.workcell.goals is not None
        names = [name for name in playable_names() if goals or "arm" not in playable(name).choices]
        return tuple(dict.fromkeys([*([wanted] if wanted else []), *names]))

    @cached_property
    def figure(self) -> Figure:
        return Figure(TargetModel(self.arm).kinematics, simple=self.simple)


def setup_of(
    arm: str,
    *,
    calibration: str | None = None,
    repair: bool = False,
    tool: Tool | None = None,
    srdf: str | None = None,
    simple: bool = False,
    policy: str | None = None,
    results: str | None = None,
    environment: str | None = None,
    **options: Any,
) -> Setup:
    """Check the arguments and return the setup of every tab; the other options are those of `ArmFlags`."""
    description = ArmFlags(calibration, repair, tool, srdf=srdf, **options).arm(arm)
    nominal = None if calibration is None else ArmFlags(tool=tool, srdf=srdf, **options).arm(arm)
    given = "".join(f", {name}={value!r}" for name, value in options.items() if value)
    module, _, attribute = arm.partition(":")
    sheet = repr(arm.lower()) if arm.lower() in arm_names() else f"import_module({module!r}).{attribute}"
    if arm.lower().endswith(FILES):
        sheet = f"ArmDescription.from_file({arm!r}{given})"
    expression = sheet if calibration is None else calibrated(sheet, calibration, repair=repair)
    if srdf is not None:
        sheet, expression = (f"{described(each)}.with_srdf({srdf!r})" for each in (sheet, expression))
    if tool is not None:
        sheet, expression = with_tool(sheet, tool), with_tool(expression, tool)
    setup = Setup(
        description, expression, sheet, simple, nominal, calibration, policy=policy, results=results,
        environment=environment, words=("--arm", arm),
    )  # fmt: skip
    setup.environments  # noqa: B018  (refuses an unknown policy or environment)
    if results is not None:
        read_results(results)
    return setup

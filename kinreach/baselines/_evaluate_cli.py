"""The command line of the evaluation of policies."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
from rich.markup import escape
from rich.progress import Progress

from kinreach import _provenance as provenance
from kinreach._checks import STEP_LIMIT, check_count, check_known, check_path, check_step_limit
from kinreach._engines import load_extra
from kinreach._files import make_writable, write_text
from kinreach._objects import load_module
from kinreach._registration import BUTTON, MOVING
from kinreach._terminal import Console
from kinreach.baselines._batch import make_batch
from kinreach.baselines._evaluation import SPLITS, TABLE_WIDTH, evaluate, evaluation_table
from kinreach.baselines._minari_export import check_dataset, record_episodes
from kinreach.baselines._onnx_export import export_onnx
from kinreach.baselines._policies import LearnedPolicy, load_policy, pretrained_names
from kinreach.baselines._policy_file import read_policy, run_name, save_policy
from kinreach.cli import Parser, quoted
from kinreach.errors import InputError

#: Default number of goals.
SPLIT = "held-out"
#: Options of the environment that belong to what a policy of the button task was trained for.
TASK_OPTIONS = ("actuation", STEP_LIMIT)
#: Values of `--collisions`.
TRUTH = ("true", "false")


def main(argv: Sequence[str], *, prog: str) -> int:
    """Evaluate policies on goals that no training has seen."""
    arguments = _parser(prog).parse_args(argv)
    check_count("--goals", arguments.goals, most=10**7)
    check_known("split", arguments.split, SPLITS)
    environment = arguments.env
    if environment is not None:
        module, _, arguments.env = environment.rpartition(":")
        if module:
            load_module("environment", module, environment)
        check_known("environment", arguments.env, gym.registry)
    policies = {name: load_policy(name) for name in arguments.policies}
    names = _short_names(list(policies))
    options = {name: _options(policy, arguments) for name, policy in policies.items()}
    _check_outputs(arguments)
    summaries = {
        names[name]: _evaluate(policy, names[name], arguments, options[name]) for name, policy in policies.items()
    }
    keys = ("backend", "observation", "exposure", STEP_LIMIT, "collisions")
    chosen = {"env": environment, **{key: getattr(arguments, key) for key in keys}}
    given = "".join(f" --{name.replace('_', '-')} {value}" for name, value in chosen.items() if value is not None)
    split = "" if arguments.split == SPLIT else f" --split {arguments.split}"
    command = f"{prog} {' '.join(map(quoted, arguments.policies))} --goals {arguments.goals}{split}{given}"
    title = f"{arguments.goals} {arguments.split} goals{given.replace(' --', ', ')}"
    console = Console(width=TABLE_WIDTH)
    console.print(evaluation_table(summaries, title=title))
    console.note(f"Again: {command}")
    if arguments.out is not None:
        found = {
            "policies": summaries,
            "split": arguments.split,
            "command": command,
            "versions": provenance.versions(),
        }
        write_text(Path(arguments.out), json.dumps(found, indent=2, allow_nan=False) + "\n")
    if arguments.record:
        for name in arguments.policies:
            _record(name, command, summaries[names[name]])
    if arguments.export is not None:
        (name,) = policies
        _export(policies[name], arguments, options[name], {command: summaries[names[name]]})
    for what, written in (("Results", arguments.out), ("ONNX model", arguments.export), ("Dataset", arguments.minari)):
        if written is not None:
            console.note(f"{what}: {written}")
    return 0


def _check_outputs(arguments: Any) -> None:
    """Refuse what could not be written after all the episodes."""
    if arguments.record and (shipped := sorted(set(arguments.policies) & set(pretrained_names()))):
        raise InputError(f"--record needs the path of a policy file, not the name of one of the package: {shipped[0]}")
    if arguments.record and arguments.split != SPLIT:
        raise InputError(f"--record is for what was measured on {SPLIT} goals, not on {arguments.split} goals")
    paths = list(arguments.policies) if arguments.record else []
    for option, path in (("--out", arguments.out), ("--export", arguments.export)):
        if path is not None:
            if check_path(option, path).is_dir():
                raise InputError(f"{option} must be a file, got {path!r}")
            paths.append(path)
    for option, value in (("--export", arguments.export), ("--minari", arguments.minari)):
        if value is not None and len(arguments.policies) > 1:
            raise InputError(f"{option} is for one policy, got {len(arguments.policies)}")
    if arguments.export is not None:
        load_extra("onnx", "onnx")
    if arguments.minari is not None:
        check_dataset(arguments.minari)
    for path in paths:
        make_writable(Path(path).parent)


def _environment(policy: LearnedPolicy, name: str, arguments: Any) -> str:
    environment = arguments.env or policy.card.environment
    if environment not in gym.registry:
        known = [known for known in gym.registry if known.startswith("kinreach/")]
        its = repr(environment) if environment else "none"
        raise InputError(f"{name} is for the environment {its}; name it with --env, such as {', '.join(known)}")
    return environment


def _options(policy: LearnedPolicy, arguments: Any) -> dict[str, Any]:
    """Options of the policy's environment: from the command line, else the environment's defaults.

    The length of an episode and the actuation of the button task belong to what a policy was trained for: they are
    those of its card, if the card has them and no option overrides them.
    """
    given = {name: getattr(arguments, name) for name in ("backend", "observation", "exposure", STEP_LIMIT)}
    trained: dict[str, Any] = {}
    environment = arguments.env or policy.card.environment
    if arguments.collisions is not None:
        check_known("--collisions", arguments.collisions, TRUTH)
        if environment != MOVING:
            raise InputError("--collisions is for policies of the moving ball")
        trained["collisions"] = arguments.collisions == TRUTH[0]
    if environment == BUTTON:
        if any(value is not None for name, value in given.items() if name != STEP_LIMIT):
            raise InputError("--backend, --observation and --exposure are for reach policies")
        card = policy.options
        trained = {name: card[name] for name in TASK_OPTIONS if name in card}
    options = trained | {name: value for name, value in given.items() if value is not None}
    check_step_limit(options)
    return options


def _evaluate(policy: LearnedPolicy, name: str, arguments: Any, options: dict[str, Any]) -> dict[str, Any]:
    goals, seed, console = arguments.goals, SPLITS[arguments.split], Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        shown = bar.add_task(escape(name), total=goals)
        play = evaluate if arguments.minari is None else partial(record_episodes, arguments.minari)
        evaluation = play(
            policy,
            goals=goals,
            seed=seed,
            environment=_environment(policy, name, arguments),
            options=options,
            progress=lambda done: bar.update(shown, completed=done),
        )
    return evaluation.summary()


def _short_names(policies: Sequence[str]) -> dict[str, str]:
    """Return names for the table, by what the user typed; where two would be the same, that itself."""
    short = [run_name(Path(name)) or Path(name).stem for name in policies]
    return {name: text if short.count(text) == 1 else name for name, text in zip(policies, short, strict=True)}


def _record(name: str, command: str, summary: dict[str, Any]) -> None:
    card, network = read_policy(name)
    save_policy(name, replace(card, results={**card.results, command: summary}), network)


def _export(policy: LearnedPolicy, arguments: Any, options: dict[str, Any], results: dict[str, Any]) -> None:
    """Write the policy as an ONNX model for the environment that it was evaluated in, with what was measured."""
    card = replace(policy.card, results={**policy.card.results, **results})
    needed = {**policy.needed_options, **options}
    env = make_batch(_environment(policy, arguments.policies[0], arguments), 1, needed)
    (count,) = env.single_observation_space.shape or (None,)
    env.close()
    export_onnx(LearnedPolicy(card, policy.network), arguments.export, observations=count)


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog, description="Play one deterministic episode for each of many goals that no training saw."
    )
    parser.add_argument(
        "policies", nargs="+", metavar="POLICY", help=f"files, or of the package: {', '.join(pretrained_names())}"
    )
    parser.add_argument(
        "--env",
        metavar="ID",
        help="another environment than the policy's own; yours as module:id",
    )
    parser.add_argument("--goals", type=int, default=1000, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--split",
        default=SPLIT,
        metavar="GOALS",
        help="held-out, for results, or validation, to choose settings by (default: %(default)s)",
    )
    parser.add_argument("--backend", help="kinematic or mujoco (default: mujoco)")
    parser.add_argument(
        "--observation", help="geometric or camera (default: geometric, or pixels where the policy sees pictures)"
    )
    parser.add_argument(
        "--exposure", type=float, metavar="FACTOR", help="pictures are up to so much brighter or darker (default: 1)"
    )
    parser.add_argument(
        "--max-episode-steps",
        type=int,
        metavar="N",
        help="of an episode (default: the environment's; of the button task as in training)",
    )
    parser.add_argument(
        "--collisions",
        metavar="|".join(TRUTH),
        help="whether a collision ends an episode with the moving ball (default: as in training)",
    )
    parser.add_argument("--out", metavar="FILE", help="write all figures with their intervals as JSON")
    parser.add_argument("--export", metavar="FILE.onnx", help="write the policy as an ONNX model")
    parser.add_argument(
        "--minari", metavar="NAME", help="write the episodes as a Minari dataset, such as ur5-single-v0"
    )
    parser.add_argument("--record", action="store_true", help="write them into the policy files; of held-out goals")
    return parser

"""The state of a training run on disk, so that it can go on after an interruption.

Tensors and plain values only, read with torch's loader for weights, which runs no code from the file.
"""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from kinreach.baselines.models import Trainee
from kinreach.errors import InputError
from kinreach.files import replacing

#: Attributes of algorithms that change during training, as far as an algorithm has them.
_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_n_calls", "exploration_rate", "rate")
_CURVE = ("rows", "steps", "episodes", "trace", "traced", "_sums", "_counted", "_ended")
_BUFFER = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_checkpoint(path: Path, identity: dict[str, Any], segment: int, trainee: Trainee) -> None:
    """Write the state after a segment, whole or not at all.

    Args:
        path: Of the file.
        identity: Recipe, seed and versions of the run; `sources`, digests of the code that had a part in the state.
        segment: Its number.
        trainee: In that state.

    Raises:
        OutputError: The file system refused.
    """
    model, curve = trainee.model, trainee.curve
    state: dict[str, Any] = {
        "identity": identity,
        "segment": segment,
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach() for name in _variables(model)},
        "counters": {name: getattr(model, name) for name in _COUNTERS if hasattr(model, name)},
        "curve": {name: getattr(curve, name) for name in _CURVE},
    }
    if isinstance(model, OffPolicyAlgorithm) and model.replay_buffer is not None:
        buffer: Any = model.replay_buffer
        kept = buffer.buffer_size if buffer.full else buffer.pos
        arrays = {name: torch.from_numpy(getattr(buffer, name)[:kept]) for name in _BUFFER}
        state["buffer"] = {"arrays": arrays, "pos": buffer.pos, "full": buffer.full}
    content = io.BytesIO()  # torch's own file writer reports a full disk as a damaged archive
    torch.save(state, content)
    with replacing(path) as temporary:
        temporary.write_bytes(content.getbuffer())


def load_checkpoint(path: Path, identity: dict[str, Any], trainee: Trainee) -> tuple[int, list[str]]:
    """Put a fresh trainee into the state after the last segment.

    Args:
        path: Of the file.
        identity: What was given to `save_checkpoint`, but for `sources`: the code may have changed.
        trainee: A fresh one.

    Returns:
        The number of the next segment, and `sources`: digests of the code that had a part in the state.

    Raises:
        InputError: The file is not a checkpoint, or is one of another run.
    """
    try:
        content = io.BytesIO(path.read_bytes())
        if not zipfile.is_zipfile(content):  # torch would try it as a plain pickle, and warn before it refuses
            raise ValueError("no archive")
        content.seek(0)
        state = torch.load(content, weights_only=True)
        said = dict(state["identity"])
        sources = said.pop("sources", None)
        if said != identity or not isinstance(sources, list):
            raise InputError(
                f"{path} belongs to a run with other settings or versions; train without --resume, or elsewhere"
            )
        model, curve = trainee.model, trainee.curve
        model.set_parameters(state["parameters"], exact_match=True)
        for name in _variables(model):
            getattr(model, name).data.copy_(state["variables"][name])
        for name in (name for name in _COUNTERS if hasattr(model, name)):
            setattr(model, name, _number(state["counters"][name]))
        for name in _CURVE:
            setattr(curve, name, state["curve"][name])
        if "buffer" in state:
            buffer: Any = model.replay_buffer  # type: ignore[attr-defined]
            for name in _BUFFER:
                rows = state["buffer"]["arrays"][name]
                getattr(buffer, name)[: len(rows)] = rows.numpy()
            buffer.pos, buffer.full = state["buffer"]["pos"], state["buffer"]["full"]
        return int(state["segment"]) + 1, [str(source) for source in sources]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (pickle.UnpicklingError, RuntimeError, KeyError, TypeError, AttributeError, EOFError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} is no checkpoint, or a damaged one") from None


def _number(value: Any) -> Any:
    if not isinstance(value, int | float):
        raise TypeError(f"a counter must be a number, got {type(value).__name__}")
    return value


def _variables(model: BaseAlgorithm) -> list[str]:
    """Names of tensors that are no parameters of a module, such as SAC's entropy coefficient."""
    return list(model._get_torch_save_params()[1])

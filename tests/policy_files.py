"""Policy files as people have them: copies of those in the package, and their networks under other cards."""

import json
from pathlib import Path

from safetensors import safe_open
from safetensors.numpy import save_file

import kinreach

SHIPPED = Path(kinreach.__file__).parent / "baselines" / "pretrained"


def copy_policy(name: str, file: Path | str, **fields: object) -> None:
    """Write a policy of the package to `file`, with these fields of its card."""
    with safe_open(SHIPPED / f"{name}.safetensors", framework="numpy") as shipped:
        card = json.loads(shipped.metadata()["kinreach"])
        tensors = {key: shipped.get_tensor(key) for key in shipped.keys()}  # noqa: SIM118 (no mapping)
    assert fields.keys() <= card.keys()
    save_file(tensors, file, metadata={"kinreach": json.dumps(card | fields)})

"""What is no regular file is refused where a training goes on, at once and in one line."""

import pytest

from tests.robustness.test_special_files import KINDS, refused


def read_checkpoint(path):
    pytest.importorskip("torch")
    pytest.importorskip("stable_baselines3")
    from kinreach.baselines._training import read_checkpoint

    read_checkpoint(path, {})


def read_run(path):
    pytest.importorskip("stable_baselines3")
    from kinreach.baselines._training import kept_run

    (path.parent / "policy.safetensors").write_bytes(b"")
    kept_run(path.parent, {})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("reader", "name"), [(read_checkpoint, "checkpoint.pt"), (read_run, "run.json")])
def test_special_files_are_refused_at_once(reader, name, kind, tmp_path):
    assert name in refused(reader, name, kind, tmp_path)

"""Scenes are compiled once and copied."""

from dataclasses import replace

from kinreach.robots import get_arm
from kinreach.sim import ArmSimulation
from kinreach.sim import _scene as scene_module
from kinreach.sim._scene import TIMESTEP, scene_model
from kinreach.sim.inside import build_scene


def test_a_scene_is_compiled_once_and_everybody_gets_a_copy(monkeypatch):
    arm, compiled = replace(get_arm("arm3"), name="compiled once"), []
    build = scene_module.build_scene
    monkeypatch.setattr(scene_module, "build_scene", lambda *a, **k: compiled.append(1) or build(*a, **k))
    one, other = scene_model(arm, visual=False), scene_model(arm, visual=False)
    assert one is not other
    assert len(compiled) == 1
    monkeypatch.undo()
    assert scene_model(arm, timestep=0.001, visual=False).opt.timestep == 0.001
    assert scene_model(arm, visual=False).opt.timestep == TIMESTEP
    assert build_scene(arm) is not build_scene(arm)
    default, plain = build_scene(arm), build_scene(arm, visual=False)
    assert len(default.geoms) > len(plain.geoms)


def test_noise_of_the_encoders_needs_no_other_scene():
    ArmSimulation("ur5-thesis")
    kept = scene_module._compiled.cache_info().currsize
    ArmSimulation("ur5-thesis", imperfections={"encoder_noise": 1e-4})  # of the reading, not of the scene
    assert scene_module._compiled.cache_info().currsize == kept

"""How scenes look: shapes, colours, lights and cameras, as they are kept in tests/data/looks.txt.

`KINREACH_KEEP=1 pytest tests/sim/test_looks.py` keeps what there is now; look at a picture before you commit it.
"""

import os

import mujoco
import numpy as np

from kinreach.envs.inside import ACTUATIONS, torque_model
from kinreach.robots import get_arm
from kinreach.sim.inside import OBJECTS, build_scene

ARM3 = get_arm("arm3")
SCENES = {
    "ur5": lambda: build_scene(get_arm("ur5-thesis")).compile(),
    "arm3 to measure": lambda: build_scene(ARM3, visual=False, objects=2).compile(),
    "button": lambda: torque_model(ARM3, ACTUATIONS["tuned"]),
}
FIELDS = {
    "geom": ("type", "size", "pos", "quat", "rgba", "group", "matid", "contype", "conaffinity", "condim"),
    "mat": ("texid", "texuniform", "texrepeat", "specular", "shininess", "reflectance", "rgba"),
    "light": ("type", "pos", "dir", "castshadow", "ambient", "diffuse", "specular"),
    "cam": ("bodyid", "pos", "quat", "fovy"),
    "tex": ("type", "height", "width", "nchannel"),
    "mesh": ("vertnum", "facenum", "normalnum"),
}
#: Fields that say how all is drawn.
WHOLE = {"vis.quality": ("shadowsize", "offsamples"), "vis.global_": ("offwidth", "offheight"), "stat": ("extent",
         "center"), "vis.map": ("znear", "zfar", "shadowclip"), "vis.headlight": ("ambient", "diffuse", "specular"),
         "vis.rgba": ("haze",), "opt": ("cone", "impratio", "timestep", "integrator", "disableflags")}  # fmt: skip


def written(values):
    """Numbers in words that are the same on every machine."""
    return " ".join(f"{value + 0.0:.5g}" for value in np.round(np.ravel(values).astype(float), 6).tolist())


def looks(model):
    kinds = mujoco.mjtObj
    named = {"geom": kinds.mjOBJ_GEOM, "mat": kinds.mjOBJ_MATERIAL, "light": kinds.mjOBJ_LIGHT,
             "cam": kinds.mjOBJ_CAMERA, "tex": kinds.mjOBJ_TEXTURE, "mesh": kinds.mjOBJ_MESH}  # fmt: skip
    for kind, fields in FIELDS.items():
        for index in range(getattr(model, f"n{kind}")):
            name = mujoco.mj_id2name(model, named[kind], index)
            if kind == "geom" and model.geom_contype[index] and name not in ("floor", "table", *OBJECTS):
                continue  # shapes of the links, which are the arm's
            on = f" on {model.body(model.geom_bodyid[index]).name}" if kind == "geom" else ""
            whose = fields
            if kind == "geom" and model.geom_dataid[index] >= 0:  # where MuJoCo puts a mesh's axes is its own business
                whose = ("rgba", "group", "contype")
            values = (f"{field} {written(getattr(model, f'{kind}_{field}')[index])}" for field in whose)
            yield f"{kind} {name}{on}: {', '.join(values)}"
    for part, fields in WHOLE.items():
        found = model
        for step in part.split("."):
            found = getattr(found, step)
        yield f"{part}: {', '.join(f'{field} {written(getattr(found, field))}' for field in fields)}"
    yield f"pixels: {written(model.tex_data.reshape(-1)[:: max(1, len(model.tex_data) // 40)])}"
    yield f"normals: {written(np.abs(model.mesh_normal).sum(axis=0).round(2))}"


def test_scenes_look_as_they_are_kept(root):
    lines = [f"{name} | {line}" for name, scene in SCENES.items() for line in looks(scene())]
    assert len(lines) > 80
    path = root / "tests/data/looks.txt"
    if os.environ.get("KINREACH_KEEP"):
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    kept = path.read_text(encoding="utf-8").splitlines()
    assert [line for line in kept if line not in lines] == [], "if it is meant: KINREACH_KEEP=1 pytest tests/sim"

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription, get_arm
from kinreach.sim import ArmSimulation
from kinreach.sim.inside import build_scene
from tests.cases import slow
from tests.robots.peoples_files import MASS, arm, shape

ARMS = ("arm3", "ur10-thesis", "ur3-thesis", "ur5-thesis")


def postures(kinematics, count, seed=0):
    return np.random.default_rng(seed).uniform(kinematics.lower, kinematics.upper, (count, kinematics.n))


@pytest.mark.parametrize("visual", [False, True])
@pytest.mark.parametrize("name", ["arm3", "ur5-thesis", *slow("ur10-thesis", "ur3-thesis")])
def test_every_registered_arm_compiles_and_is_free_of_contact_at_home(name, visual):
    simulation = ArmSimulation(name, visual=visual)
    assert simulation.contacts() == ()
    np.testing.assert_array_equal(simulation.q, simulation.arm.home)


@pytest.mark.parametrize("name", ARMS)
def test_every_frame_agrees_with_pinocchio(name):
    simulation, kinematics = ArmSimulation(name), ArmKinematics(name, base="world")
    links = [frame for frame in kinematics.model.frames if frame.type == pin.FrameType.BODY]
    bodies = [simulation.model.body(frame.name).id for frame in links]
    frames = [kinematics.model.getFrameId(frame.name) for frame in links]
    assert {*simulation.arm.tips.values(), simulation.arm.base} <= {frame.name for frame in links}
    sites = [(simulation.model.site(tip).id, kinematics.model.getFrameId(tip)) for tip in simulation.arm.tips.values()]
    worst = 0.0
    compared = 0
    for q in postures(kinematics, 1000):
        pin.framesForwardKinematics(kinematics.model, kinematics.data, q)
        simulation.data.qpos[simulation.controller.qpos] = q
        mujoco.mj_kinematics(simulation.model, simulation.data)
        for body, frame in zip(bodies, frames, strict=True):
            placement = kinematics.data.oMf[frame]
            error_p = np.abs(simulation.data.xpos[body] - placement.translation).max()
            error_R = np.abs(simulation.data.xmat[body].reshape(3, 3) - placement.rotation).max()
            worst = max(worst, error_p, error_R)
            compared += 1
        for site, frame in sites:
            placement = kinematics.data.oMf[frame]
            error_p = np.abs(simulation.data.site_xpos[site] - placement.translation).max()
            error_R = np.abs(simulation.data.site_xmat[site].reshape(3, 3) - placement.rotation).max()
            worst = max(worst, error_p, error_R)
            compared += 1
    assert compared == 1000 * (len(links) + len(sites))
    assert len(links) >= {"ur5-thesis": 12, "arm3": 5}.get(name, 3)
    assert worst <= 1e-9


@pytest.mark.parametrize("name", ARMS)
def test_frames_read_from_the_simulation_agree_with_the_kinematics(name):
    simulation = ArmSimulation(name)
    for tip, frame in simulation.arm.tips.items():
        kinematics = ArmKinematics(name, tip=tip, base="world")
        for q in postures(kinematics, 20, seed=1):
            simulation.reset(q)
            np.testing.assert_allclose(simulation.T_world_frame(frame), kinematics.fk(q), atol=1e-9)
            if tip == simulation.arm.default_tip:
                np.testing.assert_allclose(simulation.tip_position, kinematics.fk(q)[:3, 3], atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_mass_matrix_agrees_with_pinocchio(name):
    simulation, kinematics = ArmSimulation(name), ArmKinematics(name)
    model, data, n = simulation.model, simulation.data, kinematics.n
    full = np.empty((model.nv, model.nv))
    for q in postures(kinematics, 100, seed=2):
        simulation.reset(q)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, full)
        M = pin.crba(kinematics.model, kinematics.data, q)
        M = np.triu(M) + np.triu(M, 1).T + simulation.arm.armature * np.eye(n)
        np.testing.assert_allclose(full[:n, :n], M, atol=1e-9)


@pytest.mark.parametrize("name", ["arm3", "ur5-thesis", *slow("ur10-thesis", "ur3-thesis")])
def test_drives_are_those_of_the_description(name):
    arm, model = get_arm(name), build_scene(get_arm(name)).compile()
    kinematics = ArmKinematics(name)
    for index, joint in enumerate(arm.joints):
        view, servo = model.joint(joint), model.actuator(joint)
        assert servo.gainprm[0] == arm.position_gains[index]
        assert model.dof_armature[view.dofadr[0]] == arm.armature
        assert model.dof_damping[view.dofadr[0]].max() == arm.joint_damping[index]
        np.testing.assert_allclose(view.range, (kinematics.lower[index], kinematics.upper[index]), atol=1e-12)
        effort = kinematics.model.effortLimit[index]
        np.testing.assert_allclose(model.jnt_actfrcrange[view.id], (-effort, effort))
        assert model.jnt_actgravcomp[view.id] == 1
        assert model.jnt_actfrclimited[view.id] == 1
    links = [model.body(frame.name).id for frame in kinematics.model.frames if frame.type == pin.FrameType.BODY]
    assert all(model.body_gravcomp[body] == 1 for body in links if body != 0)


def test_gripper_stays_open_as_described_while_the_arm_moves(ur5):
    gripper = ur5.arm.gripper
    ur5.move(np.array(ur5.arm.home) + 0.4)
    opening = [ur5.data.joint(name).qpos[0] for name in (gripper.joint, gripper.mimic_joint)]
    np.testing.assert_allclose(opening, gripper.opening / 2, atol=5e-4)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.slow
def test_ball_has_no_contact_and_obstacles_are_named(name):
    arm, model = get_arm(name), build_scene(get_arm(name)).compile()
    ball = model.geom("ball")
    assert (ball.contype[0], ball.conaffinity[0], ball.size[0]) == (0, 0, arm.workcell.ball_radius)
    for box in arm.workcell.obstacles:
        np.testing.assert_allclose(model.geom(box.name).size, np.array(box.size) / 2)
        np.testing.assert_allclose(model.body(box.name).pos, box.position)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.slow
def test_nothing_is_excluded_that_can_touch(name):
    arm, model = get_arm(name), build_scene(get_arm(name)).compile()
    known = {frozenset(pair) for pair in (*arm.disabled_collisions, *arm.workcell.touching)}
    excluded = {
        frozenset((model.body(int(pair) >> 16).name, model.body(int(pair) & 0xFFFF).name))
        for pair in model.exclude_signature
    }
    assert known <= excluded
    checker, kinematics = CollisionChecker(arm), ArmKinematics(name)
    assert {tuple(sorted(pair)) for pair in excluded - known} <= set(checker.pairs)
    touching = {frozenset(pair) for q in postures(kinematics, 800, seed=4) for pair in checker.contacts(q)}
    assert len(touching) >= 2
    assert not touching & excluded


def test_the_obstacles_are_out_of_the_first_links_reach(ur5):
    bodies = {box.name for box in ur5.arm.workcell.obstacles}
    pairs = [(int(pair) >> 16, int(pair) & 0xFFFF) for pair in ur5.model.exclude_signature]
    names = [{ur5.model.body(body).name for body in pair} for pair in pairs]
    assert {name for pair in names if "shoulder_link" in pair for name in pair} >= bodies


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_that_touches_nothing_has_no_constraint_to_solve(name):
    simulation = ArmSimulation(name)
    mujoco.mj_forward(simulation.model, simulation.data)
    assert simulation.data.nefc == 0


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.slow
def test_drawing_does_not_change_the_physics(name):
    plain, drawn = ArmSimulation(name, visual=False), ArmSimulation(name, visual=True)
    rng = np.random.default_rng(3)
    targets = rng.uniform(plain.controller.lower, plain.controller.upper, (6, len(plain.arm.joints)))
    pressing = plain.controller.upper
    touched = 0
    for target in (*targets, pressing):
        results = [simulation.move(target) for simulation in (plain, drawn)]
        touched += bool(results[0].touches)
        assert results[0].touches == results[1].touches
        assert results[0].status is results[1].status
        np.testing.assert_array_equal(plain.data.qpos, drawn.data.qpos)
        np.testing.assert_array_equal(plain.data.qvel, drawn.data.qvel)
    assert touched > 0, "the moves were to include contacts"


def test_visual_meshes_are_drawn_and_collision_meshes_are_hidden():
    model = build_scene(get_arm("ur5-thesis"), visual=True).compile()
    drawn = [i for i in range(model.ngeom) if model.geom_contype[i] == 0 and model.geom_dataid[i] >= 0]
    solid = [i for i in range(model.ngeom) if model.geom_contype[i] == 1 and model.geom_dataid[i] >= 0]
    assert len(drawn) >= 14
    assert {int(model.geom_group[i]) for i in drawn} == {2}
    assert len(solid) == 7
    assert {int(model.geom_group[i]) for i in solid} == {3}


def test_meshes_of_a_few_triangles_are_drawn(tmp_path):
    """One alone has three vertices; MuJoCo takes a mesh of four or more."""
    rng, drawn = np.random.default_rng(0), 0
    for count in (1, 2, 3):
        trimesh.Trimesh(rng.uniform(-0.1, 0.1, (3 * count, 3)), np.arange(3 * count).reshape(-1, 3)).export(
            tmp_path / "few.stl"
        )
        shapes = shape('<mesh filename="few.stl"/>') + shape('<sphere radius="0.01"/>', "collision")
        (tmp_path / "a.urdf").write_text(arm(links=dict.fromkeys(range(7), MASS) | {3: MASS + shapes}))
        model = build_scene(ArmDescription.from_urdf(tmp_path / "a.urdf"), visual=True).compile()
        (geom,) = (i for i in range(model.ngeom) if model.geom_dataid[i] >= 0)
        assert model.geom_group[geom] == 2
        assert model.mesh_facenum[model.geom_dataid[geom]] == max(count, 2)
        drawn += 1
    assert drawn == 3


@pytest.mark.parametrize(
    ("name", "colours"),
    [
        ("ur5-thesis", {"gripper_palm": (0.62, 0.64, 0.67), "finger_left": (0.20, 0.21, 0.23)}),
        ("arm3", {"base_link": (0.25, 0.26, 0.28), "link_1": (0.20, 0.36, 0.55), "link_3": (0.86, 0.48, 0.16)}),
    ],
)
def test_boxes_and_cylinders_have_the_colours_of_the_urdf(name, colours):
    """Policies that see pictures were trained with them."""
    model = ArmSimulation(name, visual=False).model
    for link, colour in colours.items():
        shown = model.geom_rgba[model.geom_bodyid == model.body(link).id]
        assert len(shown) >= 1
        assert shown[:, :3] == pytest.approx(np.tile(colour, (len(shown), 1)))

"""Worlds of other programs: each format against its own simulator, and scenes that come back as they were."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
import yaml

from poise.assembly import (
    Assembly,
    Box,
    Cylinder,
    FrictionPair,
    Mesh,
    RigidObject,
    Sphere,
    acceleration_limits,
    load_scene,
)
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_of_vector
from poise.shape import check_mesh
from poise.worlds import read_world, save_scene, world_formats, write_world
from poise.worlds.assembling import inertial_of

SCENES = Path(__file__).parents[2] / "docs" / "scenes"


def limits_of(assembly: Assembly) -> np.ndarray:
    return acceleration_limits(assembly, np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])).limits


def mixed() -> Assembly:
    """A floor, a turned box with a centre of mass of its own, a cylinder on it, and an L of wood as a mesh."""
    turn = rotation_of_vector(np.array([0.0, 0.0, 0.3]))
    legs = [trimesh.creation.box([0.3, 0.1, 0.1]), trimesh.creation.box([0.1, 0.1, 0.2])]
    legs[1].apply_translation([-0.1, 0.0, 0.15])
    corners = np.concatenate([leg.vertices for leg in legs])
    faces = np.concatenate([legs[0].faces, legs[1].faces + len(legs[0].vertices)])
    whole = check_mesh(corners, faces, name="l")
    return Assembly(
        (
            RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True),
            RigidObject(
                "crate",
                Box((0.4, 0.3, 0.2)),
                Pose(turn, np.array([0.1, 0.2, 0.1])),
                mass=3.0,
                com=np.array([0.02, 0.0, -0.01]),
                inertia=np.diag([0.03, 0.04, 0.05]),
            ),
            RigidObject("can", Cylinder(0.05, 0.15), Pose(turn, np.array([0.1, 0.2, 0.275])), mass=0.5),
            RigidObject(
                "bracket", Mesh(whole.vertices, whole.triangles), Pose(np.eye(3), np.array([-0.5, 0.0, 0.05])), mass=1.5
            ),
        ),
        friction=0.4,
    )


def same(one: Assembly, other: Assembly) -> None:
    """Both have the same bodies in the same places."""
    assert [item.id for item in one.objects] == [item.id for item in other.objects]
    np.testing.assert_allclose(other.gravity, one.gravity, rtol=1e-12)
    for a, b in zip(one.objects, other.objects, strict=True):
        assert a.fixed == b.fixed
        low, high = (np.array([item.vertices.min(axis=0), item.vertices.max(axis=0)]) for item in (a, b))
        np.testing.assert_allclose(high, low, atol=1e-6)
        if not a.fixed:
            assert b.mass == pytest.approx(a.mass, rel=1e-6)
            np.testing.assert_allclose(b.com_in_world, a.com_in_world, atol=1e-7)
            np.testing.assert_allclose(b.inertia_in_world, a.inertia_in_world, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("ending", [".xml", ".sdf"])
def test_a_scene_comes_back_from_a_simulator_s_file_with_the_same_limits(tmp_path: Path, ending: str) -> None:
    scene = mixed()
    assert write_world(scene, tmp_path / f"world{ending}") == ()
    back, _ = read_world(tmp_path / f"world{ending}")
    same(scene, back)
    np.testing.assert_allclose(limits_of(back), limits_of(scene), rtol=1e-3)


def test_mujoco_and_bullet_load_what_is_written(tmp_path: Path) -> None:
    mujoco, bullet = pytest.importorskip("mujoco"), pytest.importorskip("pybullet")
    scene = mixed()
    write_world(scene, tmp_path / "world.xml")
    write_world(scene, tmp_path / "world.sdf")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "world.xml"))
    client = bullet.connect(bullet.DIRECT)
    numbers = bullet.loadSDF(str(tmp_path / "world.sdf"), physicsClientId=client)
    for item, number in zip(scene.objects, numbers, strict=True):
        if item.fixed:
            continue
        body, known = model.body(item.id), inertial_of(item)
        assert body.mass[0] == pytest.approx(item.mass)
        np.testing.assert_allclose(body.ipos, known.com, atol=1e-9)
        np.testing.assert_allclose(np.sort(body.inertia), np.linalg.eigvalsh(known.inertia), rtol=1e-6)
        assert bullet.getDynamicsInfo(number, -1, physicsClientId=client)[0] == pytest.approx(item.mass)
        at, _ = bullet.getBasePositionAndOrientation(number, physicsClientId=client)
        np.testing.assert_allclose(at, item.com_in_world, atol=1e-6)
    bullet.disconnect(client)


def test_mujoco_gets_room_for_the_contacts_of_many_geoms(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    places = 0.1 * np.arange(60)
    scene = Assembly(
        tuple(
            RigidObject(f"b{x:.1f}", Box((0.1, 0.1, 0.1)), Pose(np.eye(3), np.array([x, 0, 0])), True) for x in places
        )
    )
    few = Assembly(scene.objects[:3])
    write_world(scene, tmp_path / "many.xml")
    write_world(few, tmp_path / "few.xml")
    sizes = [mujoco.MjModel.from_xml_path(str(tmp_path / f"{name}.xml")).narena for name in ("many", "few")]
    assert sizes[0] >= 1 << 30
    assert sizes[1] < 1 << 25


def test_what_a_format_cannot_express_is_said_and_pairs_of_mjcf_come_back(tmp_path: Path) -> None:
    scene = mixed()
    scene = Assembly(scene.objects, friction=0.4, friction_pairs=(FrictionPair(("floor", "crate"), 0.7),))
    (lost,) = write_world(scene, tmp_path / "world.sdf")
    assert "floor and crate" in lost
    assert "not written: friction of floor" in (tmp_path / "world.sdf").read_text()
    write_world(scene, tmp_path / "world.xml")
    back, _ = read_world(tmp_path / "world.xml")
    assert back.friction_between("floor", "crate") == pytest.approx(0.7)
    assert back.friction_between("crate", "can") == pytest.approx(0.4)


def test_round_bodies_that_touch_have_a_pair_in_mjcf_and_no_others(tmp_path: Path) -> None:
    """Rolling resistance between radii a and b is that of 1 / (1 / a + 1 / b); MuJoCo would take the larger one."""
    places = {"low": 0.05, "high": 0.15, "far": 5.0, "named": 0.25}
    balls = [
        RigidObject(name, Sphere(0.05), Pose(np.eye(3), np.array([0, 0, z])), mass=1.0) for name, z in places.items()
    ]
    floor = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    named = FrictionPair(("high", "named"), 0.3, rolling=0.08)
    write_world(Assembly((floor, *balls), rolling=0.04, friction_pairs=(named,)), tmp_path / "world.xml")
    contact = ElementTree.parse(tmp_path / "world.xml").getroot().find("contact")
    assert contact is not None
    levers = {
        (pair.attrib["geom1"], pair.attrib["geom2"]): float(pair.attrib["friction"].split()[-1]) for pair in contact
    }
    assert levers == pytest.approx({("high", "named"): 0.08 * 0.025, ("low", "high"): 0.04 * 0.025})


def test_a_world_of_gazebo_is_read_with_frames_welds_and_includes(tmp_path: Path) -> None:
    (tmp_path / "mug").mkdir()
    (tmp_path / "mug" / "model.config").write_text("<model><sdf version='1.7'>mug.sdf</sdf></model>")
    (tmp_path / "mug" / "mug.sdf").write_text(
        "<sdf version='1.7'><model name='mug'><link name='body'>"
        "<inertial><pose>0 0 0.05 0 0 0</pose><mass>0.3</mass></inertial>"
        "<collision name='c'><pose>0 0 0.05 0 0 0</pose><geometry><cylinder><radius>0.04</radius><length>0.1</length>"
        "</cylinder></geometry></collision></link></model></sdf>"
    )
    (tmp_path / "world.sdf").write_text(
        """<sdf version='1.9'><world name='w'><gravity>0 0 -9.81</gravity>
        <model name='ground'><static>true</static><link name='l'><collision name='c'><geometry>
          <plane><normal>0 0 1</normal></plane></geometry></collision></link></model>
        <frame name='corner'><pose>1 2 0 0 0 1.5707963267948966</pose></frame>
        <model name='tool'><pose relative_to='corner'>0.5 0 0.1 0 0 0</pose>
          <link name='handle'><inertial><mass>1</mass><inertia><ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia>
            </inertial><collision name='c'><geometry><box><size>0.2 0.2 0.2</size></box></geometry>
            <surface><friction><ode><mu>0.6</mu></ode></friction></surface></collision></link>
          <link name='head'><pose relative_to='handle'>0.2 0 0 0 0 0</pose><inertial><mass>3</mass><inertia>
            <ixx>0.02</ixx><iyy>0.02</iyy><izz>0.02</izz></inertia></inertial>
            <collision name='c'><geometry><box><size>0.2 0.2 0.2</size></box></geometry></collision></link>
          <joint name='weld' type='fixed'><parent>handle</parent><child>head</child></joint></model>
        <include><uri>model://mug</uri><name>cup</name><pose>0 -1 0 0 0 0</pose></include>
        </world></sdf>"""
    )
    scene, notes = read_world(tmp_path / "world.sdf")
    assert [item.id for item in scene.objects] == ["ground", "tool", "cup"]
    assert [item.fixed for item in scene.objects] == [True, False, False]
    tool = scene.objects[1]
    assert tool.mass == pytest.approx(4.0)
    # The tool lies along y, because its frame is turned by a right angle: the head is 0.2 m farther.
    np.testing.assert_allclose(tool.com_in_world, [1.0, 2.65, 0.1], atol=1e-9)
    np.testing.assert_allclose(np.ptp(tool.vertices, axis=0), [0.2, 0.4, 0.2], atol=1e-9)
    np.testing.assert_allclose(scene.objects[2].com_in_world, [0.0, -1.0, 0.05], atol=1e-9)
    assert scene.friction_between("ground", "tool") == pytest.approx(0.6)  # the least of 0.6 and SDFormat's default 1
    assert scene.friction_between("ground", "cup") == pytest.approx(1.0)
    assert any("several coefficients" in note for note in notes)
    assert "3 collision shapes have no friction; SDFormat's default of 1 is taken" in notes
    assert not any("no friction" in note for note in read_world(tmp_path / "world.sdf", friction=0.4)[1])


def test_what_holds_bodies_in_mujoco_alone_is_said_to_be_left_out(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    box = "<geom type='box' size='.05 .05 .05'/>"
    (tmp_path / "model.xml").write_text(
        f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/>
        <body name="a" pos="0 0 .05"><freejoint/>{box}</body>
        <body name="b" pos="0 0 .15" gravcomp="1"><freejoint/>{box}</body></worldbody>
        <equality><weld body1="a" body2="b"/><weld body1="a" body2="b" active="false"/></equality>
        <contact><exclude body1="a" body2="b"/></contact>
        <keyframe><key qpos="0 0 1 1 0 0 0 0 0 2 1 0 0 0"/></keyframe></mujoco>"""
    )
    notes = read_world(tmp_path / "model.xml")[1]
    for what in ("1 equality constraint", "1 excluded pair", "1 keyframe", "1 bodies have gravity compensation"):
        assert any(note.startswith(what) for note in notes), what


def test_a_model_of_mujoco_is_read_as_mujoco_has_it(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "model.xml").write_text(
        """<mujoco><compiler angle="radian"/><option gravity="0 0 -1.62"/><worldbody>
        <geom name="ground" type="plane" size="0 0 1" friction="0.3"/>
        <body name="table" pos="0 0 0.4"><geom type="box" size="0.5 0.5 0.4"/></body>
        <body name="ball" pos="3 0 0.1"><freejoint/><geom type="sphere" size="0.1" density="1000"/></body>
        <body name="lamp" pos="0 0 0.85"><freejoint/><geom type="cylinder" size="0.05 0.05" mass="1" friction="0.8"/>
          <body name="shade" pos="0 0 0.1"><geom type="capsule" size="0.05 0.05" mass="0.5"/>
          <geom type="box" size="1 1 1" contype="0" conaffinity="0" mass="0"/></body></body>
        <body name="door" pos="5 0 1"><joint type="hinge" axis="0 0 1"/><geom type="box" size="0.5 0.02 1"/></body>
        </worldbody></mujoco>"""
    )
    scene, notes = read_world(tmp_path / "model.xml")
    assert [item.id for item in scene.objects] == ["ground", "table", "ball", "lamp", "door"]
    assert [item.fixed for item in scene.objects] == [True, True, False, False, True]
    ball, lamp = scene.objects[2], scene.objects[3]
    assert ball.mass == pytest.approx(4 / 3 * np.pi)
    assert ball.shape.volume == pytest.approx(ball.mass / 1000, rel=0.01)
    assert lamp.mass == pytest.approx(1.5)
    np.testing.assert_allclose(lamp.com_in_world, [0, 0, 0.85 + 0.1 / 3], atol=1e-9)
    assert np.ptp(lamp.vertices[:, 2]) == pytest.approx(0.25, abs=1e-6)
    np.testing.assert_allclose(scene.gravity, [0, 0, -1.62])
    # Of two surfaces MuJoCo takes the greater coefficient; its default is 1.
    assert scene.friction_between("ground", "ball") == pytest.approx(1.0)
    assert scene.friction_between("table", "lamp") == pytest.approx(1.0)
    assert any("door" in note and "joint" in note for note in notes)
    assert "friction of 4 geoms is 1, the default of MuJoCo; is it known?" in notes


def test_a_urdf_is_one_object_that_needs_a_floor(tmp_path: Path) -> None:
    (tmp_path / "bottle.urdf").write_text(
        """<robot name="bottle"><link name="body"><inertial><origin xyz="0 0 0.1"/><mass value="0.8"/>
        <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial>
        <collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.04" length="0.2"/></geometry></collision></link>
        <link name="cap"><inertial><mass value="0.05"/></inertial><collision><geometry>
        <cylinder radius="0.02" length="0.02"/></geometry></collision></link>
        <joint name="j" type="fixed"><origin xyz="0 0 0.205"/><parent link="body"/><child link="cap"/></joint>
        </robot>"""
    )
    with pytest.raises(InputError, match="nothing in the file is fixed"):
        read_world(tmp_path / "bottle.urdf")
    scene, notes = read_world(tmp_path / "bottle.urdf", friction=0.5, floor=0.0)
    bottle = scene.objects[0]
    assert bottle.mass == pytest.approx(0.85)
    assert np.ptp(bottle.vertices[:, 2]) == pytest.approx(0.215, abs=1e-6)
    # It topples at g r / h of its centre of mass.
    height = (0.8 * 0.1 + 0.05 * 0.205) / 0.85
    least = min(0.5 * 9.80665, 9.80665 * 0.04 / height)
    np.testing.assert_allclose(limits_of(scene), least, rtol=5e-3)
    assert not notes


def test_a_world_link_and_floating_joints_make_a_scene(tmp_path: Path) -> None:
    (tmp_path / "cell.urdf").write_text(
        """<robot name="cell"><link name="world"/>
        <link name="table"><collision><geometry><box size="1 1 0.1"/></geometry></collision></link>
        <link name="part"><inertial><mass value="2"/></inertial><collision><geometry>
        <box size="0.1 0.1 0.1"/></geometry></collision></link>
        <joint name="a" type="fixed"><parent link="world"/><child link="table"/></joint>
        <joint name="b" type="floating"><origin xyz="0.1 0 0.1"/><parent link="table"/><child link="part"/></joint>
        </robot>"""
    )
    scene, _ = read_world(tmp_path / "cell.urdf")
    assert [(item.id, item.fixed) for item in scene.objects] == [("cell::table", True), ("cell::part", False)]
    np.testing.assert_allclose(scene.objects[1].pose.translation, [0.1, 0, 0.1])


def test_meshes_are_written_beside_a_scene_file(tmp_path: Path) -> None:
    save_scene(mixed(), tmp_path / "scene.yaml")
    same(mixed(), load_scene(tmp_path / "scene.yaml"))


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("a.sdf", "<sdf><world", ErrorCode.FILE_CORRUPT),
        ("a.sdf", "<!DOCTYPE a [<!ENTITY b 'c'>]><sdf/>", ErrorCode.FILE_CORRUPT),
        (
            "a.sdf",
            "<sdf><world name='w'><include><uri>model://nowhere</uri></include></world></sdf>",
            ErrorCode.FILE_UNREADABLE,
        ),
        (
            "a.sdf",
            "<sdf><world name='w'><include><uri>https://fuel/x</uri></include></world></sdf>",
            ErrorCode.UNSUPPORTED,
        ),
        (
            "a.sdf",
            "<sdf><model name='m'><pose relative_to='x'>0 0 0 0 0 0</pose></model></sdf>",
            ErrorCode.FRAME_UNKNOWN,
        ),
        ("a.sdf", "<sdf><model name='m'><pose>0 0 nan 0 0 0</pose></model></sdf>", ErrorCode.BAD_INPUT),
        ("a.xml", "<html/>", ErrorCode.UNSUPPORTED),
        ("a.xml", "<mujoco><worldbody><body/></worldbody></mujoco", ErrorCode.FILE_CORRUPT),
        ("a.urdf", "<robot name='r' xmlns:xacro='x'><xacro:y/></robot>", ErrorCode.UNSUPPORTED),
        ("a.scene", "name\n* a\n0 0 0\n", ErrorCode.FILE_CORRUPT),
        ("a.json", '{"world": {"collision_objects": [{"id": 3}]}}', ErrorCode.FILE_CORRUPT),
    ],
)
def test_files_that_cannot_be_read_have_a_code_and_a_sentence(
    tmp_path: Path, name: str, content: str, code: ErrorCode
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError) as caught:
        read_world(tmp_path / name)
    assert caught.value.code == code, caught.value.message


def test_a_scene_file_has_masses_of_its_own(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="scene file"):
        read_world(SCENES / "tray.yaml", masses={"a": 1.0})
    with pytest.raises(InputError, match="no format has this ending"):
        write_world(mixed(), tmp_path / "a.step")
    assert {kind.name for kind in world_formats()} == {"mjcf", "moveit", "sdf", "urdf"}


@pytest.mark.parametrize("ending", [".xml", ".sdf", ".scene", ".json"])
def test_a_ball_comes_back_as_a_ball(tmp_path: Path, ending: str) -> None:
    floor = RigidObject("floor", Box((2.0, 2.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    ball = RigidObject("ball", Sphere(0.05), Pose(np.eye(3), np.array([0, 0, 0.05])), mass=0.4)
    write_world(Assembly((floor, ball), friction=0.4), tmp_path / f"a{ending}")
    masses = {"ball": 0.4} if ending in (".scene", ".json") else {}
    back, _ = read_world(tmp_path / f"a{ending}", masses=masses, friction=0.4)
    assert back.objects[1].shape == Sphere(0.05)
    np.testing.assert_allclose(back.objects[1].com_in_world, [0, 0, 0.05], atol=1e-9)
    np.testing.assert_allclose(back.objects[1].inertia_in_world, 0.4 * 0.4 * 0.05**2 * np.eye(3), rtol=1e-6)


@pytest.mark.parametrize("ending", [".yaml", ".yml", ".YAML"])
def test_yaml_is_a_scene_file_with_masses_and_friction(tmp_path: Path, ending: str) -> None:
    """MoveIt's messages are read from YAML, too, but written as .json or .scene."""
    scene = mixed()
    assert write_world(scene, tmp_path / f"a{ending}") == ()
    back, _ = read_world(tmp_path / f"a{ending}")
    assert back.friction == scene.friction
    for a, b in zip(scene.objects, back.objects, strict=True):
        assert (a.id, a.fixed) == (b.id, b.fixed)
        np.testing.assert_allclose(b.vertices, a.vertices, atol=1e-9)
        assert a.fixed or abs(a.mass - b.mass) < 1e-12


@pytest.mark.parametrize("ending", [".scene", ".json"])
def test_a_planning_scene_comes_back(tmp_path: Path, ending: str) -> None:
    scene = mixed()
    masses = {item.id: item.mass for item in scene.objects if not item.fixed}
    assert write_world(scene, tmp_path / f"a{ending}") == ("MoveIt knows neither masses nor friction",)
    assert "-9.75) m/s2" in write_world(replace(scene, gravity=np.array([1.0, 0, -9.75])), tmp_path / f"b{ending}")[1]
    back, notes = read_world(tmp_path / f"a{ending}", masses=masses, friction=0.4)
    assert [item.id for item in back.objects] == [item.id for item in scene.objects]
    for a, b in zip(scene.objects, back.objects, strict=True):
        assert a.fixed == b.fixed
        assert type(a.shape) is type(b.shape)
        np.testing.assert_allclose(np.sort(b.vertices, axis=0), np.sort(a.vertices, axis=0), atol=1e-9)
    assert "floor: the file has no mass for it, or 0; it is fixed" in notes
    with pytest.raises(InputError, match="there is no lid"):
        read_world(tmp_path / f"a{ending}", masses={"lid": 1.0})


def test_the_message_and_the_older_text_of_moveit_are_read(tmp_path: Path) -> None:
    ball, tip = (
        "* ball\n1\nsphere\n0.05\n1 0 0.05\n0 0 0 1\n0 0 0 0\n",
        "* tip\n1\ncone\n0.1 0.2\n0 0 0.1\n0 0 0 1\n0 0 0 0\n",
    )
    (tmp_path / "older.scene").write_text(f"scene\n{ball}{tip}.\n")
    scene, _ = read_world(tmp_path / "older.scene", masses={"ball": 1.0, "tip": 1.0}, friction=0.5, floor=0.0)
    ball, tip = scene.objects[:2]
    np.testing.assert_allclose(ball.com_in_world, [1, 0, 0.05], atol=1e-6)
    np.testing.assert_allclose(tip.com_in_world, [0, 0, 0.05], atol=1e-6)  # a quarter of its height
    message = {
        "is_diff": True,
        "world": {
            "collision_objects": [
                {
                    "header": {"frame_id": "world"},
                    "id": "dumbbell",
                    "pose": {"position": {"z": 0.05}},
                    "primitives": [{"type": 1, "dimensions": [0.1, 0.1, 0.1]}] * 2
                    + [{"type": 1, "dimensions": [0.2, 0.02, 0.02]}],
                    "primitive_poses": [{"position": {"x": 0.1}}, {"position": {"x": -0.1}}, {}],
                }
            ]
        },
        "robot_state": {"attached_collision_objects": [{"object": {"id": "cup"}}]},
    }
    (tmp_path / "message.yaml").write_text(yaml.safe_dump(message) + "---\n")
    scene, notes = read_world(tmp_path / "message.yaml", masses={"dumbbell": 2.0}, friction=0.5, floor=0.0)
    assert scene.objects[0].shape.volume == pytest.approx(2e-3 + 0.1 * 0.02**2, rel=1e-6)
    assert any("difference" in note for note in notes)
    assert any("cup" in note for note in notes)

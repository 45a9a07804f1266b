"""Models of simulators: MuJoCo's own dynamics decide, and a model of Gazebo of the same arm agrees."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from poise.errors import ErrorCode, InputError
from poise.robot import RobotModel
from poise.simulation import IdealRobot, JointMotion
from poise.simulation.models import JointPhysics, SimulatorModel, read_simulator_model

MJCF = """<!-- an arm of three joints, each about a point and from a reference of its own -->
<mujoco><compiler angle="radian"/><option gravity="0 0 -9.7"/><default><joint damping="2"/></default>
<worldbody><body name="a" pos="0.1 0 .2" euler=".1 .2 .3">
<joint name="j1" axis="0 1 1" pos=".05 0 .02" ref=".3" frictionloss=".4"/>
<joint name="j2" axis="1 0 0" pos="0 .1 0" armature=".2" stiffness="3" springref=".1" damping="0"/>
<geom size=".1 .05 .07" type="box" pos=".1 0 0" euler="0 .3 0"/>
<body name="b" pos="0 0 .4" euler="0 .3 0">
<joint name="s" type="slide" axis="0 0 1" ref=".02" range="-.2 .3" limited="true" damping="0"/>
<geom size=".05 .1" type="cylinder"/>
<body name="tool" pos="0.05 0 .1" euler=".2 0 0"><site name="ft" pos="0 0 .01" euler="0 0 .3"/>
<geom size=".03" pos="0 .02 .05" mass="1.3"/>
</body></body></body><body name="cube"><freejoint/><geom size=".1"/></body></worldbody>
<actuator><position joint="j1" name="servo" kp="100" kv="5"/><motor joint="j2" gear="3" forcerange="-4 4"/></actuator>
<sensor><force site="ft" noise=".2"/><torque site="ft" noise=".01"/></sensor></mujoco>"""

SDF = """<?xml version="1.0"?><sdf version="1.9"><model name="arm">
<link name="base"/><link name="upper"><pose>0 0 0.3 0 0 0</pose>
<inertial><pose>0 0 0.1 0 0.2 0</pose><mass>2</mass><inertia><ixx>.02</ixx><iyy>.02</iyy><izz>.004</izz></inertia>
</inertial></link>
<frame name="elbow" attached_to="upper"><pose>0 0 0.2 0 0 0</pose></frame>
<link name="lower"><pose relative_to="elbow">0.02 0 0.05 0 0.4 0</pose>
<inertial><pose>0 0 0.15 0 0 0</pose><mass>1</mass><inertia><ixx>.01</ixx><iyy>.01</iyy><izz>.001</izz></inertia>
</inertial></link>
<joint name="fix" type="fixed"><parent>world</parent><child>base</child></joint>
<joint name="j1" type="revolute"><parent>base</parent><child>upper</child>
<axis><xyz>0 1 0</xyz><dynamics><damping>1.5</damping><friction>.3</friction><spring_stiffness>2</spring_stiffness>
</dynamics></axis></joint>
<joint name="j2" type="revolute"><pose>0 0 -0.05 0 0 0</pose><parent>upper</parent><child>lower</child>
<axis><xyz expressed_in="__model__">1 0 0</xyz><limit><lower>-2</lower><upper>2</upper></limit></axis>
<sensor name="ft" type="force_torque"><force_torque><force><x><noise type="gaussian"><stddev>0.1</stddev></noise></x>
</force></force_torque></sensor></joint>
<plugin filename="gz" name="gz::sim::systems::JointPositionController"><joint_name>j1</joint_name><p_gain>50</p_gain>
<d_gain>2</d_gain></plugin>
</model></sdf>"""

SAME_ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="upper" pos="0 0 .3">
<joint name="j1" axis="0 1 0"/>
<inertial pos="0 0 .1" mass="2" diaginertia=".02 .02 .004" euler="0 .2 0"/>
<body name="lower" pos="0.02 0 0.25" euler="0 .4 0">
<joint name="j2" axis="0.9210609940028851 0 0.3894183423086505" pos="0 0 -.05"/>
<inertial pos="0 0 .15" mass="1" diaginertia=".01 .01 .001"/></body></body></worldbody></mujoco>"""


def written(folder: Path, text: str, name: str = "model.xml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def states(joints: int, count: int = 3) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(count, 3, joints)) * 0.4


def rigid(model: SimulatorModel, frame: str, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Efforts and wrench of the rigid arm."""
    robot = RobotModel.from_urdf(model.urdf, frame)
    ideal = IdealRobot(robot, None, (0, 0, -(model.gravity or 9.81)), tool_in_wrench=True)
    truth = ideal.simulate(np.array([0]), JointMotion(*(each[None] for each in state)))
    return truth.effort[0], truth.wrench_in_sensor[0]


def test_efforts_and_wrench_are_those_of_mujoco(tmp_path: Path) -> None:
    path = written(tmp_path, MJCF)
    read, model = read_simulator_model(path), mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    for q, v, a in states(3):
        data.qpos[:3], data.qvel[:3], data.qacc[:3] = q, v, a
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        mujoco.mj_sensorAcc(model, data)
        passive = np.array([2 * v[0], 3 * (q[1] - 0.1) + 0.2 * a[1], 0.0])
        effort, wrench = rigid(read, "ft", np.array([q, v, a]))
        np.testing.assert_allclose(effort, data.qfrc_inverse[:3] - passive, atol=1e-9)
        np.testing.assert_allclose(wrench, -data.sensordata, atol=1e-9)


def test_physics_of_joints_drives_and_sensors(tmp_path: Path) -> None:
    read = read_simulator_model(written(tmp_path, MJCF))
    assert read.joints == {
        "j1": JointPhysics(0.4, 2.0, ramp=read.joints["j1"].ramp, lead=0.0095),
        "j2": JointPhysics(0.0, 0.0, 0.2, 3.0, 0.1),
        "s": JointPhysics(),
    }
    servo, motor = read.drives["j1"], read.drives["j2"]
    assert (servo.name, servo.kind, servo.gain, servo.stiffness, servo.damping) == ("servo", "position", 100, 100, 5)
    assert (motor.kind, motor.gear, motor.limit) == ("effort", 3.0, (-4.0, 4.0))
    assert [(each.frame, each.force, each.torque) for each in read.sensors] == [("ft", 0.2, 0.01)]
    assert read.gravity == 9.7
    assert 'name="cube"' not in read.urdf


def test_a_model_of_gazebo_is_the_same_arm(tmp_path: Path) -> None:
    gazebo = read_simulator_model(written(tmp_path, SDF, "model.sdf"))
    other = read_simulator_model(written(tmp_path, SAME_ARM))
    for state in states(2):
        np.testing.assert_allclose(rigid(gazebo, "lower", state)[0], rigid(other, "lower", state)[0], atol=1e-9)
    assert gazebo.joints["j1"] == JointPhysics(0.3, 1.5, 0.0, 2.0)
    assert gazebo.drives["j1"].stiffness == 50.0
    assert gazebo.sensor(None).force == 0.1
    assert rigid(gazebo, "ft", np.zeros((3, 2)))[1][2] == pytest.approx(-9.81 * np.cos(0.4), rel=1e-6)


def test_included_files_and_missing_meshes(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="m" file="gone.stl"/></asset>'
    body = '<body name="a"><joint name="j"/>{}<geom type="mesh" mesh="m"/><geom size=".1" mass="0"/></body>'
    inner = "<mujoco><worldbody>" + body.format('<inertial pos="0 0 .1" mass="1" diaginertia=".1 .1 .1"/>')
    written(tmp_path, f"{inner}</worldbody>{mesh}</mujoco>", "arm.xml")
    outer = written(tmp_path, '<mujoco><include file="arm.xml"/></mujoco>')
    read = read_simulator_model(outer)
    assert list(read.joints) == ["j"]
    assert read.left_out == ("shapes of the missing meshes m",)
    weightless = f"<mujoco><worldbody>{body.format('')}</worldbody>{mesh}</mujoco>"
    for text, code, said in (
        (weightless, ErrorCode.FILE_UNREADABLE, "mass from it"),
        (
            '<mujoco><include file="none.xml"/></mujoco>',
            ErrorCode.ROBOT_DESCRIPTION_INVALID,
            "included file is missing",
        ),
        ("<mujoco><worldbody><body/></mujoco>", ErrorCode.ROBOT_DESCRIPTION_INVALID, "MuJoCo cannot load it"),
        ('<mujoco><option gravity="1 0 -9"/></mujoco>', ErrorCode.UNSUPPORTED, "so that z is up"),
        ("<sdf><include><uri>model://arm</uri></include></sdf>", ErrorCode.UNSUPPORTED, "gz sdf -p"),
        ("<sdf><model/><model/></sdf>", ErrorCode.UNSUPPORTED, "0 models with joints"),
        (SDF.replace('relative_to="elbow"', 'relative_to="knee"'), ErrorCode.ROBOT_DESCRIPTION_INVALID, "knee"),
        ("<!DOCTYPE x><sdf/>", ErrorCode.BAD_INPUT, "no model"),
        ("<usd/>", ErrorCode.BAD_INPUT, "give MJCF"),
    ):
        with pytest.raises(InputError, match=said) as caught:
            read_simulator_model(written(tmp_path, text))
        assert caught.value.code is code

"""The contract of exporters: what each writes is read back by other means and equals the estimate."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.exporting import EXPORTED_VALUES, Exporter, ExportSettings, GripperLoad, all_exporters, export, exporter_of
from poise.geometry import Pose
from poise.inertia import InertialEstimate, InertialParameters
from poise.inertia.model import EstimateFinding

TURN = Rotation.from_euler("xyz", [0.3, -0.5, 0.7]).as_matrix()
PAYLOAD = InertialParameters(1.6, np.array([0.01, -0.02, 0.19]), TURN @ np.diag([0.009, 0.006, 0.004]) @ TURN.T)
GRIPPER = InertialParameters(0.4, np.array([0.0, 0.01, 0.05]), np.diag([4e-4, 5e-4, 3e-4]))
MOUNT = Pose(Rotation.from_euler("xyz", [0.1, 0.2, -0.4]).as_matrix(), np.array([0.001, 0.002, 0.04]))

HAND = """
  <link name="hand"><inertial><origin xyz="0 0.01 0.05" rpy="0.2 0 0"/><mass value="0.4"/>
    <inertia ixx="4e-4" ixy="0" ixz="0" iyy="5e-4" iyz="0" izz="3e-4"/></inertial></link>
  <joint name="grasp" type="fixed"><parent link="ft_sensor"/><child link="hand"/></joint>"""
ROBOT = """<?xml version="1.0"?>
<robot name="arm">
  <!-- a comment that stays -->
  <link name="base"/>
  <link name="ft_sensor"><inertial><origin xyz="0.01 0 0.02" rpy="0.3 0.1 0"/><mass value="0.3"/>
    <inertia ixx="3e-4" ixy="1e-5" ixz="0" iyy="2e-4" iyz="0" izz="1.5e-4"/></inertial></link>
  <link name="payload"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="ft_sensor"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 0.5"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="mount" type="fixed"><parent link="base"/><child link="payload"/></joint>%s
</robot>
"""
SETTINGS = ExportSettings(robot_description=ROBOT % "")

Values = tuple[float, np.ndarray, np.ndarray | None]
"""Mass, centre of mass and the inertia about it, where the format has one."""


def estimate_of(parameters: InertialParameters, frame_id: str = "ft_sensor") -> InertialEstimate:
    return InertialEstimate(
        stamp=0,
        frame_id=frame_id,
        parameters=parameters,
        phi=parameters.phi,
        covariance=1e-6 * np.eye(10),
        bias=np.zeros(6),
        bias_covariance=1e-6 * np.eye(6),
        delay=np.nan,
        delay_std=np.nan,
        method="poise",
        consistent=parameters.is_consistent,
        unidentified=(),
        condition_number=1.0,
        n_samples=1000,
        rejected=(),
        residual_force=0.1,
        residual_torque=0.01,
    )


def symmetric(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> np.ndarray:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def by_pinocchio(text: str) -> Values:
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    inertia = model.inertias[1]
    return inertia.mass, inertia.lever, inertia.inertia


def by_robot(text: str) -> Values:
    """What the joint moves now, less what it moved before."""
    after, before = (pin.buildModelFromXML(each).inertias[1] for each in (text, ROBOT % ""))
    added = after.toDynamicParameters() - before.toDynamicParameters()
    inertia = pin.Inertia.FromDynamicParameters(added)
    assert "a comment that stays" in text
    return inertia.mass, inertia.lever, inertia.inertia


def by_mujoco(text: str) -> Values:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "payload")
    rotation = Rotation.from_quat(np.roll(model.body_iquat[body], -1)).as_matrix()
    inertia = rotation @ np.diag(model.body_inertia[body]) @ rotation.T
    return model.body_mass[body], model.body_ipos[body], inertia


def by_sdf(text: str) -> Values:
    inertial = ElementTree.fromstring(text).find(".//inertial")
    assert inertial is not None
    pose = np.array(inertial.findtext("pose", "").split(), dtype=float)
    np.testing.assert_array_equal(pose[3:], 0.0)
    six = [float(inertial.findtext(f"inertia/{name}", "nan")) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
    return float(inertial.findtext("mass", "nan")), pose[:3], symmetric(*six)


def by_urscript(text: str) -> Values:
    line = text.splitlines()[-1]
    mass, com, (xx, yy, zz, xy, xz, yz), *_ = json.loads(
        f"[{line.removeprefix('set_target_payload(').removesuffix(')')}]"
    )
    return mass, np.array(com), symmetric(xx, xy, xz, yy, yz, zz)


def by_set_load(text: str) -> Values:
    request = json.loads(text)
    inertia = np.array(request["load_inertia"]).reshape(3, 3).T
    return request["mass"], np.array(request["center_of_mass"]), inertia


def by_driver_request(text: str) -> Values:
    request = json.loads(text)
    com = np.array([request["center_of_gravity"][name] for name in "xyz"])
    return request["mass"], com, symmetric(*(request[name] for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")))


def by_desk(text: str) -> Values:
    config = json.loads(text)
    assert config["transformation"] == np.eye(4).ravel().tolist()
    return config["mass"], np.array(config["centerOfMass"]), np.array(config["inertia"]).reshape(3, 3).T


def by_xarm_call(text: str) -> Values:
    mass, com = json.loads("[" + text.splitlines()[-1].removeprefix("arm.set_tcp_load(").removesuffix(")") + "]")
    return mass, np.array(com) * 1e-3, None


def by_krl(text: str) -> Values:
    number = r"(-?\d+\.\d+)"
    mass, x, y, z, a, b, c, *moments = (float(found) for found in re.findall(number, text[text.index("$LOAD") :]))
    axes = [Rotation.from_rotvec(np.deg2rad(angle) * np.eye(3)[axis]) for angle, axis in ((a, 2), (b, 1), (c, 0))]
    rotation = (axes[0] * axes[1] * axes[2]).as_matrix()  # each about the axes that the one before has turned
    return mass, np.array([x, y, z]) * 1e-3, rotation @ np.diag(moments) @ rotation.T


def by_attached_object(text: str) -> Values:
    message = yaml.safe_load(text)
    edges = np.array(message["object"]["primitives"][0]["dimensions"])
    pose = message["object"]["primitive_poses"][0]
    rotation = Rotation.from_quat([pose["orientation"][name] for name in "xyzw"]).as_matrix()
    moments = (
        message["weight"]
        / 12
        * np.array([edges[1] ** 2 + edges[2] ** 2, edges[0] ** 2 + edges[2] ** 2, edges[0] ** 2 + edges[1] ** 2])
    )
    com = np.array([pose["position"][name] for name in "xyz"])
    return message["weight"], com, rotation @ np.diag(moments) @ rotation.T


def by_json(text: str) -> Values:
    content = json.loads(text)
    return content["mass"], np.array(content["com"]), symmetric(*content["inertia"])


READERS: dict[str, Callable[[str], Values]] = {
    "urdf": by_pinocchio,
    "urdf-robot": by_robot,
    "urdf-link": by_robot,
    "mjcf": by_mujoco,
    "sdf": by_sdf,
    "ur": by_urscript,
    "ur-driver": by_driver_request,
    "franka": by_set_load,
    "franka-desk": by_desk,
    "xarm": by_xarm_call,
    "kuka": by_krl,
    "moveit": by_attached_object,
    "json": by_json,
}

each = pytest.mark.parametrize("exporter", all_exporters(), ids=lambda exporter: exporter.kind)


def same(found: Values, truth: InertialParameters) -> None:
    mass, com, inertia = found
    assert mass == pytest.approx(truth.mass, rel=1e-8)
    np.testing.assert_allclose(com, truth.com, atol=2e-9)
    if inertia is not None:
        np.testing.assert_allclose(inertia, truth.inertia, atol=2e-9)


@each
def test_what_is_written_is_read_back_as_the_estimate(exporter: Exporter) -> None:
    assert exporter_of(exporter.kind) is exporter
    assert exporter.summary
    found = READERS[exporter.kind](export(estimate_of(PAYLOAD), exporter.kind, SETTINGS))
    same(found, PAYLOAD)
    assert (found[2] is None) <= ("inertia" in exporter.omits)
    assert set(exporter.needs) | set(exporter.omits) <= set(EXPORTED_VALUES)


@each
def test_controllers_take_the_values_in_the_flange_frame_and_others_in_the_sensor_frame(exporter: Exporter) -> None:
    text = export(estimate_of(PAYLOAD), exporter.kind, replace(SETTINGS, flange_from_sensor=MOUNT))
    truth = PAYLOAD
    if exporter.flange:
        inertia = MOUNT.rotation @ PAYLOAD.inertia @ MOUNT.rotation.T
        truth = InertialParameters(PAYLOAD.mass, MOUNT.rotation @ PAYLOAD.com + MOUNT.translation, inertia)
    same(READERS[exporter.kind](text), truth)


@each
def test_a_body_that_cannot_exist_is_refused_where_the_target_would_fail(exporter: Exporter) -> None:
    for impossible in (replace(PAYLOAD, inertia=np.diag([0.1, 0.01, 0.01])), replace(PAYLOAD, mass=-0.1)):
        if exporter.physical:
            with pytest.raises(NoAnswerError) as caught:
                export(estimate_of(impossible), exporter.kind, SETTINGS)
            assert caught.value.code == ErrorCode.NOT_CONSISTENT
            assert exporter.kind in caught.value.message
        else:
            same(READERS[exporter.kind](export(estimate_of(impossible), exporter.kind)), impossible)


@each
def test_an_inertia_that_is_not_known_is_refused_or_left_out(exporter: Exporter) -> None:
    partial = estimate_of(replace(PAYLOAD, inertia=np.full((3, 3), np.nan)))
    if "inertia" in exporter.needs:
        with pytest.raises(NoAnswerError, match="needs inertia") as caught:
            export(partial, exporter.kind)
        assert caught.value.code == ErrorCode.NOT_IDENTIFIABLE
    else:
        text = export(partial, exporter.kind)
        assert "nan" not in text.lower()
        assert "1.6" in text


@each
def test_a_hostile_frame_name_stays_a_name(exporter: Exporter) -> None:
    hostile = "--><evil a='1'/>\"\n$X=1"
    if exporter.robot:
        with pytest.raises(InputError, match="no link"):
            export(estimate_of(PAYLOAD, hostile), exporter.kind, SETTINGS)
        return
    text = export(estimate_of(PAYLOAD, hostile), exporter.kind)
    same(READERS[exporter.kind](text), PAYLOAD)
    assert "\n$X" not in text


def test_an_unknown_kind_is_refused_with_those_there_are() -> None:
    with pytest.raises(InputError, match="use one of franka, franka-desk, json, kuka"):
        export(estimate_of(PAYLOAD), "abb")


@each
def test_a_named_frame_holds_for_every_format_and_the_gripper_is_taken_off(exporter: Exporter) -> None:
    held = estimate_of(PAYLOAD + GRIPPER)
    if exporter.robot:  # the frame has to be a link of the robot
        same(
            READERS[exporter.kind](export(held, exporter.kind, replace(SETTINGS, gripper=GripperLoad(GRIPPER)))),
            PAYLOAD,
        )
        return
    settings = ExportSettings(frame_id="tool0", frame_from_sensor=MOUNT, gripper=GripperLoad(GRIPPER))
    text = export(held, exporter.kind, settings)
    same(READERS[exporter.kind](text), PAYLOAD.in_frame(MOUNT.rotation, MOUNT.translation))


def test_the_uncertainty_of_a_weighed_gripper_adds_to_that_of_the_object() -> None:
    held = estimate_of(PAYLOAD + GRIPPER)
    left = GripperLoad(GRIPPER, 3e-6 * np.eye(10)).taken_off(held)
    assert left.mass_std == pytest.approx(2e-3)
    assert left.parameters.mass == pytest.approx(PAYLOAD.mass)
    partly = GripperLoad(replace(GRIPPER, inertia=np.full((3, 3), np.nan))).taken_off(held)
    assert np.isfinite(partly.covariance[:4, :4]).all()
    assert np.isnan(partly.covariance[4:, 4:]).all()
    with pytest.raises(NoAnswerError, match="export urdf needs inertia"):
        export(held, "urdf", ExportSettings(gripper=GripperLoad(replace(GRIPPER, inertia=np.full((3, 3), np.nan)))))


@each
def test_an_estimate_that_may_be_wrong_is_refused_or_written_with_its_findings(exporter: Exporter) -> None:
    finding = EstimateFinding(ErrorCode.TORQUE_SIGN, "the torque has the wrong sign")
    doubtful = replace(estimate_of(PAYLOAD), findings=(finding,))
    if exporter.doubtful:
        assert json.loads(export(doubtful, exporter.kind))["findings"][0]["name"] == "TORQUE_SIGN"
        return
    with pytest.raises(NoAnswerError, match="wrong sign") as caught:
        export(doubtful, exporter.kind, SETTINGS)
    assert caught.value.code is ErrorCode.TORQUE_SIGN


@pytest.mark.parametrize(
    ("finding", "refused"),
    [
        (EstimateFinding(ErrorCode.POOR_FIT, "no payload explains it"), True),
        (EstimateFinding(ErrorCode.NOT_IDENTIFIABLE, "not above zero"), True),
        (EstimateFinding(ErrorCode.IN_CONTACT, "two masses are as likely", {"other_mass": 1.1}), True),
        (EstimateFinding(ErrorCode.IN_CONTACT, "the samples in contact were left out"), False),
        (EstimateFinding(ErrorCode.PAYLOAD_CHANGED, "the last object"), False),
        (EstimateFinding(ErrorCode.FORCE_UNIT, "repaired: the force is in kgf"), False),
        (EstimateFinding(ErrorCode.SHAPE_MISMATCH, "the answer does without the shape"), False),
    ],
)
def test_which_findings_refuse_an_export(finding: EstimateFinding, refused: bool) -> None:
    found = replace(estimate_of(PAYLOAD), findings=(finding,))
    if refused:
        with pytest.raises(NoAnswerError, match=finding.message):
            export(found, "ur")
    else:
        assert f"findings: {finding.code.name}" in export(found, "ur")


def test_an_inertia_that_was_expected_and_not_measured_is_marked() -> None:
    assumed = replace(estimate_of(PAYLOAD), unidentified=("ixx", "izz"))
    assert "ixx, izz expected, not measured" in export(assumed, "ur")


def test_the_time_of_the_change_is_an_argument_of_the_robots_that_have_it() -> None:
    settings = ExportSettings(transition_time=0.25)
    assert export(estimate_of(PAYLOAD), "ur", settings).endswith("], 0.250)\n")
    request = json.loads(export(estimate_of(PAYLOAD), "ur-driver", settings))
    assert request["transition_time"] == {"sec": 0, "nanosec": 250_000_000}
    unknown = estimate_of(replace(PAYLOAD, inertia=np.full((3, 3), np.nan)))
    same((*by_urscript(export(unknown, "ur", settings))[:2], None), PAYLOAD)
    assert "ixx" not in json.loads(export(unknown, "ur-driver", settings))


def test_a_gripper_in_the_robot_description_does_not_count_twice() -> None:
    held, robot = estimate_of(PAYLOAD + GRIPPER), ROBOT % HAND
    for kind in ("urdf-robot", "urdf-link"):
        with pytest.raises(InputError, match=r"0.4 kg beyond ft_sensor, .* would count twice"):
            export(held, kind, ExportSettings(robot_description=robot))
        assert "<link" in export(held, kind, ExportSettings(robot_description=robot, gripper=GripperLoad(GRIPPER)))
        with pytest.raises(InputError, match="--urdf") as caught:
            export(held, kind)
        assert caught.value.code is ErrorCode.ROBOT_DESCRIPTION_MISSING

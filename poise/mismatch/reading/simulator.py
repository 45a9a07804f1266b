"""The model of a simulator as the nominal model: its robot, its payload, and the physics of its joints and sensors."""

from collections.abc import Callable
from dataclasses import replace
from difflib import get_close_matches
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from poise.errors import ErrorCode, InputError
from poise.mismatch.effects import stated_sense
from poise.mismatch.reading.nominal_model import NominalModel
from poise.mismatch.recorded import RecordedMotion
from poise.robot import RobotModel, find_urdf, inertia_of, parse_urdf, phi_in_link, phi_of, read_urdf
from poise.simulation.models import JointPhysics
from poise.types import Array


def nominal_description(model: NominalModel, recorded: Callable[[], str]) -> str:
    """The robot of a nominal model as the text of a URDF: of the simulator, of a file, or of the recording.

    The link that is the payload alone has no inertial: `payload_of_link` has it.

    Raises:
        InputError: as `recorded` and `read_urdf`; FRAME_UNKNOWN for a payload link that the model lacks.
    """
    if model.simulator is not None:
        text = model.simulator.urdf
    else:
        text = recorded() if model.urdf is None else read_urdf(find_urdf(model.urdf))
    return text if model.payload_link is None else _without_inertial(text, model.payload_link)


def sensor_frame_of(model: NominalModel, frame_id: str | None) -> str | None:
    """The sensor's frame: as model.yaml says, else of the wrench's messages, else the simulator's only sensor."""
    if model.sensor_frame is not None or model.simulator is None or frame_id is None:
        return model.sensor_frame
    sensor = model.simulator.sensor(frame_id) or model.simulator.sensor(None)
    return None if sensor is None else sensor.frame


def with_simulator(model: NominalModel, robot: RobotModel) -> NominalModel:
    """The model with the payload and the noise of its simulator, as the sensor frame of a robot has them.

    Raises:
        InputError: FRAME_UNKNOWN for a payload link that moves against the sensor.
    """
    simulator = model.simulator
    if simulator is None:
        return model
    sensor = simulator.sensor(robot.sensor_frame)
    if sensor is not None:
        force, torque = model.noise_force or sensor.force or None, model.noise_torque or sensor.torque or None
        model = replace(model, noise_force=force, noise_torque=torque)
    if model.phi is not None:
        return model
    link, urdf = model.payload_link, simulator.urdf
    return replace(model, phi=np.zeros(10) if link is None else payload_of_link(urdf, link, robot.sensor_frame))


def payload_of_link(urdf: str, link: str, sensor_frame: str) -> Array:
    """(10,) the inertial of a link, about the sensor's origin in its axes.

    Raises:
        InputError: FRAME_UNKNOWN for a link that there is not, or that moves against the sensor.
    """
    tree = parse_urdf(urdf)
    _require_link(tree.links, link)
    if link not in tree.inertials:
        return np.zeros(10)
    model = pin.buildModelFromXML(urdf)
    at, sensor = (model.frames[model.getFrameId(name, pin.FrameType.BODY)] for name in (link, sensor_frame))
    if at.parentJoint != sensor.parentJoint:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN, f"the payload's link {link} moves against the sensor's frame {sensor_frame}"
        )
    moved = sensor.placement.actInv(at.placement).act(inertia_of(phi_in_link(tree.inertials[link])))
    return phi_of(moved)


def with_stated_physics(recorded: RecordedMotion, model: NominalModel) -> RecordedMotion:
    """The recording with the friction, rotors and springs of the simulator's joints in its predicted efforts."""
    effort = recorded.effort
    if model.simulator is None or effort is None:
        return recorded
    lighter = _lightness_with_load(model)
    of_joints = ((name, model.simulator.joints.get(name, JointPhysics())) for name in effort.names)
    stated = tuple(replace(each, ramp=each.ramp * lighter.get(name, 1.0)) for name, each in of_joints)
    friction, damping, armature, stiffness, rest, ramp, lead = (
        np.array([getattr(each, what) for each in stated])
        for what in ("friction", "damping", "armature", "stiffness", "rest", "ramp", "lead")
    )
    added = friction * stated_sense(effort.velocity, effort.acceleration, lead, ramp) + damping * effort.velocity
    added += armature * effort.acceleration + stiffness * (effort.position - rest)
    effort = replace(effort, prediction=effort.prediction + added, stated=stated, passive=added)
    return replace(recorded, effort=effort)


def _without_inertial(text: str, link: str) -> str:
    _require_link(parse_urdf(text).links, link)
    robot = ElementTree.fromstring(text)
    for element in robot.findall("link"):
        inertial = element.find("inertial")
        if element.get("name") == link and inertial is not None:
            element.remove(inertial)
    return ElementTree.tostring(robot, encoding="unicode")


def _require_link(links: tuple[str, ...], link: str) -> None:
    if link not in links:
        near = get_close_matches(link, links, 5, 0.4) or links[-8:]
        raise InputError(ErrorCode.FRAME_UNKNOWN, f"the model has no link {link}; it has {', '.join(near)}")


def _lightness_with_load(model: NominalModel) -> dict[str, float]:
    """Of each joint, how much lighter it is with the payload: the ramp of soft friction is proportional to that.

    MuJoCo takes the inverse of the inertia at its initial position (`dof_invweight0`), when all joints are at zero.
    """
    simulator, frame = model.simulator, model.sensor_frame
    soft = simulator is not None and any(each.ramp > 0.0 for each in simulator.joints.values())
    if simulator is None or not soft or model.phi is None or model.payload_link is not None or frame is None:
        return {}
    tree = pin.buildModelFromXML(simulator.urdf)
    if not tree.existFrame(frame):
        return {}
    columns = {name: tree.joints[tree.getJointId(name)].idx_v for name in simulator.joints if tree.existJointName(name)}
    for name, column in columns.items():
        tree.armature[column] = simulator.joints[name].armature

    def lightness() -> Array:
        return np.asarray(np.diag(pin.computeMinverse(tree, tree.createData(), pin.neutral(tree))))

    empty, at = lightness(), tree.frames[tree.getFrameId(frame)]
    tree.inertias[at.parentJoint] += at.placement.act(inertia_of(model.phi))
    lighter = lightness() / np.maximum(empty, 1e-12)
    return {name: float(lighter[column]) for name, column in columns.items() if 0.0 < lighter[column] < 1.0}

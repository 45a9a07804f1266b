"""MJCF: joints, drives, sensors and the payload of a MuJoCo model.

https://mujoco.readthedocs.io/en/stable/XMLreference.html
"""

import math
from collections.abc import Sequence

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.exporting import mjcf_inertial
from poise.exporting.models.base import DriveChange, ModelChanges, ModelExporter, SensorChange, WrittenModel
from poise.exporting.models.names import found_by_name
from poise.exporting.models.xml_text import XmlElement, XmlText
from poise.geometry import quaternion_of_rotation, rotation_of_quaternion, rotation_of_vector

_ATTRIBUTES = {"friction": "frictionloss", "damping": "damping", "armature": "armature"}
_STEP = 0.002
"""s, MuJoCo's default time step."""
_ORIENTATIONS = ("axisangle", "xyaxes", "zaxis", "euler")
_NEEDS_DELAY = "delays need a MuJoCo that has the attribute delay (4.0 does)"


class MjcfModelExporter(ModelExporter):
    """`frictionloss`, `damping`, `armature` of joints, `kp`, `kv`, `delay` of drives, sensors, the payload's body."""

    kind = "mjcf"
    summary = "MJCF: joints (frictionloss, damping, armature), drives (kp, kv, delay), sensors, the payload's body"

    def written(self, changes: ModelChanges, source: bytes) -> WrittenModel:
        """See `ModelExporter`. Values of classes and of `default` are overridden at the element."""
        text = XmlText(source, "mujoco")
        elements = [each for world in _children(text, "worldbody") for each in world.walk()]
        more = any(each.name in ("include", "model") for each in text.root.walk())
        where = "; it names other files: give the one that has the joints" if more else ""
        for joint, change in changes.joints.items():
            element = found_by_name(elements, "joint", joint, where)
            text.set_attributes(element, {_ATTRIBUTES[name]: repr(value) for name, value in change.values.items()})
        left_out: list[str] = []
        actuators = [each for group in _children(text, "actuator") for each in group.children]
        for joint, drive in changes.drives.items():
            left_out += _put_drive(text, actuators, joint, drive)
        if changes.sensor is not None:
            left_out += _put_sensor(text, elements, changes.sensor)
        if changes.payload is not None:
            if any(each.attributes.get("inertiafromgeom") == "true" for each in text.root.walk()):
                what = "the model has inertiafromgeom=true, so that MuJoCo ignores the payload; set it to auto"
                raise InputError(ErrorCode.BAD_INPUT, what)
            body = found_by_name(elements, "body", changes.payload.link, where)
            text.put_child(body, mjcf_inertial(changes.payload.parameters))
        delayed = "delay" in changes.kinds or "sensor_delay" in changes.kinds
        said = changes.leaving_out(*left_out)
        return WrittenModel(text.changed(said.remark + f"\n{_NEEDS_DELAY}" * delayed), said.left_out)


def _children(text: XmlText, name: str) -> list[XmlElement]:
    return [each for each in text.root.children if each.name == name]


def _put_drive(text: XmlText, actuators: Sequence[XmlElement], joint: str, drive: DriveChange) -> list[str]:
    """Change the position drive of a joint; what cannot be, as clauses."""
    found = [each for each in actuators if each.attributes.get("joint") == joint]
    if not drive.values:
        return []
    if len(found) != 1 or found[0].name not in ("position", "general"):
        return [f"the drive of {joint}: the model has no single <position> or <general> actuator there"]
    element = found[0]
    values: dict[str, str] = {}
    gain, rate = (None if each is None else each / _gear(element) ** 2 for each in (drive.gain, drive.rate_gain))
    if element.name == "position":
        values |= {name: repr(each) for name, each in (("kp", gain), ("kv", rate)) if each is not None}
    elif "biasprm" in element.attributes:
        bias = [*(float(each) for each in element.attributes["biasprm"].split()), 0.0, 0.0][:3]
        bias[1:] = [old if new is None else -new for old, new in zip(bias[1:], (gain, rate), strict=True)]
        values |= {"biasprm": " ".join(map(repr, bias))} | ({} if gain is None else {"gainprm": repr(gain)})
    elif gain is not None or rate is not None:
        return [f"the gain of the drive of {joint}: its <general> has no biasprm of its own"]
    if drive.delay is not None:
        values |= _delay(text, drive.delay)
    text.set_attributes(element, values)
    return []


def _delay(text: XmlText, delay: float) -> dict[str, str]:
    """A delay with a history that is long enough for it; none below half a time step."""
    steps = [each.attributes["timestep"] for each in text.root.walk() if "timestep" in each.attributes]
    step = float(steps[0]) if steps else _STEP
    if delay < 0.5 * step:
        return {}
    return {"delay": repr(delay), "nsample": str(math.ceil(delay / step) + 2)}


def _gear(element: XmlElement) -> float:
    return float(element.attributes.get("gear", "1").split()[0])


def _put_sensor(text: XmlText, elements: Sequence[XmlElement], sensor: SensorChange) -> list[str]:
    """Change the force and torque sensors of a site; what cannot be, as clauses."""
    sites = [each for each in elements if each.name == "site" and each.attributes.get("name") == sensor.frame]
    sensors = [each for group in _children(text, "sensor") for each in group.children]
    found = {each.name: each for each in sensors if each.attributes.get("site") == sensor.frame}
    if len(sites) != 1 or not {"force", "torque"} & set(found):
        return [f"{each.replace('_', ' ')}: the model has no sensor {sensor.frame}" for each in sensor.kinds]
    left_out = []
    for name, noise, limit in (
        ("force", sensor.force_noise, sensor.force_limit),
        ("torque", sensor.torque_noise, sensor.torque_limit),
    ):
        values = {} if noise is None else {"noise": repr(noise)}
        values |= {} if limit is None else {"cutoff": repr(limit)}
        values |= {} if sensor.delay is None or sensor.delay < 0.0 else _delay(text, sensor.delay)
        if name in found and values:
            text.set_attributes(found[name], values)
    if sensor.turn is not None:
        if any(each in sites[0].attributes for each in _ORIENTATIONS):
            left_out.append(f"the rotation of the sensor: write the orientation of the site {sensor.frame} as quat")
        else:
            w, x, y, z = (float(each) for each in sites[0].attributes.get("quat", "1 0 0 0").split())
            true = rotation_of_quaternion([x, y, z, w]) @ rotation_of_vector(sensor.turn)
            turned = np.roll(quaternion_of_rotation(true), 1).tolist()
            text.set_attributes(sites[0], {"quat": " ".join(repr(each) for each in turned)})
    return left_out

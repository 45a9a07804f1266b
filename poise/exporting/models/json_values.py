"""JSON: the values by joint, in SI units, and in the names of Isaac Lab, of USD's drives, and of ros2_control."""

import json
import math
from typing import Any

from poise.exporting.models.base import ModelChanges, ModelExporter, WrittenModel

_ISAAC = {"friction": ("friction", "dynamic_friction"), "damping": ("viscous_friction",), "armature": ("armature",)}
_PHYSX = {"friction": "physxJoint:jointFriction", "armature": "physxJoint:armature"}
_DEGREE = math.pi / 180.0
"""rad: the gains of angular drives in USD are per degree."""


class JsonModelExporter(ModelExporter):
    """`joints`, `drives` and `payload` in SI units; the same for `isaac_lab`, `usd` and `ros2_control`."""

    kind = "json"
    summary = "JSON: values by joint, also in the names of Isaac Lab, USD and ros2_control; the payload"
    needs_source = False

    def written(self, changes: ModelChanges, source: bytes) -> WrittenModel:
        """See `ModelExporter`."""
        del source
        load = None
        if changes.payload is not None:
            body = changes.payload.parameters
            load = {
                "link": changes.payload.link,
                "mass": body.mass,
                "com": body.com.tolist(),
                "inertia": body.inertia_vector.tolist(),
            }
        content = {
            "joints": {joint: change.values for joint, change in changes.joints.items()},
            "drives": {joint: drive.values for joint, drive in changes.drives.items()},
            "isaac_lab": _isaac_lab(changes),
            "usd": _usd(changes),
            "ros2_control": _ros2_control(changes),
            "payload": load,
            "sensor": _sensor(changes),
            "not_written": list(changes.left_out),
            "unsure": list(changes.unsure),
        }
        return WrittenModel((json.dumps(content, indent=2) + "\n").encode(), changes.left_out)


def _isaac_lab(changes: ModelChanges) -> dict[str, dict[str, float]]:
    """Arguments of `ActuatorBaseCfg`, each a mapping of joints to values; `delay` in s: Isaac Lab counts steps."""
    found: dict[str, dict[str, float]] = {}
    for joint, change in changes.joints.items():
        for name, value in change.values.items():
            for argument in _ISAAC[name]:
                found.setdefault(argument, {})[joint] = value
    for joint, drive in changes.drives.items():
        for name, argument in (("gain", "stiffness"), ("rate_gain", "damping"), ("delay", "delay")):
            if name in drive.values:
                found.setdefault(argument, {})[joint] = drive.values[name]
    return found


def _usd(changes: ModelChanges) -> dict[str, dict[str, float]]:
    """Attributes of joints: PhysX's of the joint, and UsdPhysics' of an angular drive, per degree."""
    found: dict[str, dict[str, float]] = {}
    for joint, change in changes.joints.items():
        named = {_PHYSX[name]: value for name, value in change.values.items() if name in _PHYSX}
        found.setdefault(joint, {}).update(named)
    for joint, drive in changes.drives.items():
        for name, attribute in (("gain", "stiffness"), ("rate_gain", "damping")):
            if name in drive.values:
                found.setdefault(joint, {})[f"drive:angular:physics:{attribute}"] = drive.values[name] * _DEGREE
    return found


def _ros2_control(changes: ModelChanges) -> dict[str, Any]:
    """`gains` of a joint_trajectory_controller with effort commands: what a simulated robot needs to answer alike."""
    names = {"gain": "p", "rate_gain": "d"}
    given = {
        joint: {names[name]: value for name, value in drive.values.items() if name in names}
        for joint, drive in changes.drives.items()
    }
    gains = {joint: values for joint, values in given.items() if values}
    return {"gains": gains} if gains else {}


def _sensor(changes: ModelChanges) -> dict[str, Any] | None:
    sensor = changes.sensor
    if sensor is None:
        return None
    return {
        "frame": sensor.frame,
        "noise": {"force": sensor.force_noise, "torque": sensor.torque_noise},
        "rotation": None if sensor.turn is None else sensor.turn.tolist(),
        "limit": {"force": sensor.force_limit, "torque": sensor.torque_limit},
        "delay": sensor.delay,
    }

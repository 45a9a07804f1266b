"""JSON: the values by joint, in SI units, and in the names of Isaac Lab's actuators."""

import json

from poise.exporting.models.base import ModelChanges, ModelExporter

_ISAAC = {"friction": ("friction", "dynamic_friction"), "damping": ("viscous_friction",), "armature": ("armature",)}


class JsonModelExporter(ModelExporter):
    """`joints` by name; `isaac_lab`: arguments of `ActuatorBaseCfg` (2.3), each a mapping of joints to values."""

    kind = "json"
    summary = "JSON: values by joint, also as arguments of Isaac Lab's actuators; the payload"
    needs_source = False

    def written(self, changes: ModelChanges, source: bytes) -> bytes:
        """See `ModelExporter`."""
        del source
        isaac: dict[str, dict[str, float]] = {}
        for joint, change in changes.joints.items():
            for name, value in change.values.items():
                for argument in _ISAAC[name]:
                    isaac.setdefault(argument, {})[joint] = value
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
            "isaac_lab": isaac,
            "payload": load,
            "not_written": list(changes.left_out),
        }
        return (json.dumps(content, indent=2) + "\n").encode()

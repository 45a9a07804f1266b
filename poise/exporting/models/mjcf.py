"""MJCF: joints and the payload's body of a MuJoCo model (https://mujoco.readthedocs.io/en/stable/XMLreference.html)."""

from poise.errors import ErrorCode, InputError
from poise.exporting import mjcf_inertial
from poise.exporting.models.base import ModelChanges, ModelExporter
from poise.exporting.models.names import found_by_name
from poise.exporting.models.xml_text import XmlText

_ATTRIBUTES = {"friction": "frictionloss", "damping": "damping", "armature": "armature"}


class MjcfModelExporter(ModelExporter):
    """`frictionloss`, `damping` and `armature` of joints, and the `inertial` of the payload's body."""

    kind = "mjcf"
    summary = "MJCF: frictionloss, damping and armature of the joints, the inertial of the payload's body"

    def written(self, changes: ModelChanges, source: bytes) -> bytes:
        """See `ModelExporter`. Values of classes and of `default` are overridden at the joint."""
        text = XmlText(source, "mujoco")
        bodies = [each for each in text.root.children if each.name == "worldbody"]
        elements = [each for world in bodies for each in world.walk()]
        more = any(each.name in ("include", "model") for each in text.root.walk())
        where = "; it names other files: give the one that has the joints" if more else ""
        for joint, change in changes.joints.items():
            element = found_by_name(elements, "joint", joint, where)
            text.set_attributes(element, {_ATTRIBUTES[name]: repr(value) for name, value in change.values.items()})
        if changes.payload is not None:
            if any(each.attributes.get("inertiafromgeom") == "true" for each in text.root.walk()):
                what = "the model has inertiafromgeom=true, so that MuJoCo ignores the payload; set it to auto"
                raise InputError(ErrorCode.BAD_INPUT, what)
            body = found_by_name(elements, "body", changes.payload.link, where)
            text.put_child(body, mjcf_inertial(changes.payload.parameters))
        return text.changed(changes.remark)

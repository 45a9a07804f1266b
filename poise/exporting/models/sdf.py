"""SDFormat (http://sdformat.org/spec?elem=joint): `axis/dynamics` of the joints, `inertial` of the payload's link."""

from poise.errors import ErrorCode, InputError
from poise.exporting import sdf_inertial
from poise.exporting.models.base import ModelChanges, ModelExporter
from poise.exporting.models.names import found_by_name
from poise.exporting.models.xml_text import XmlText


class SdfModelExporter(ModelExporter):
    """`friction` and `damping` of the axis of joints; SDFormat has no place for the inertia of rotors."""

    kind = "sdf"
    summary = "SDFormat: friction and damping of the joints' axes, the inertial of the payload's link"
    omits = ("armature",)

    def written(self, changes: ModelChanges, source: bytes) -> bytes:
        """See `ModelExporter`."""
        text = XmlText(source, "sdf")
        elements = list(text.root.walk())
        for joint, change in changes.joints.items():
            axis = found_by_name(elements, "joint", joint).child("axis")
            if axis is None:
                raise InputError(ErrorCode.BAD_INPUT, f"the joint {joint} of the model has no axis")
            dynamics, values = axis.child("dynamics"), change.values
            parts = {name: f"<{name}>{value!r}</{name}>" for name, value in values.items()}
            if dynamics is None:
                text.insert_first(axis, f"<dynamics>{''.join(parts.values())}</dynamics>")
                continue
            missing = ""
            for name, value in values.items():
                old = dynamics.child(name)
                if old is None:
                    missing += parts[name]
                else:
                    text.set_text(old, repr(value))
            if missing:
                text.insert_first(dynamics, missing)
        if changes.payload is not None:
            link = found_by_name(elements, "link", changes.payload.link)
            text.put_child(link, sdf_inertial(changes.payload.parameters))
        return text.changed(changes.remark)

"""URDF (http://wiki.ros.org/urdf/XML/joint): `dynamics` of the joints, `inertial` of the payload's link."""

from poise.exporting import urdf_inertial
from poise.exporting.models.base import ModelChanges, ModelExporter, WrittenModel
from poise.exporting.models.names import found_by_name
from poise.exporting.models.xml_text import XmlText


class UrdfModelExporter(ModelExporter):
    """`dynamics` of joints; a URDF has no place for the inertia of rotors."""

    kind = "urdf"
    summary = "URDF: dynamics (friction, damping) of the joints, the inertial of the payload's link"
    omits = ("armature", "gain", "rate_gain", "delay", "sensor_turn", "sensor_limit", "sensor_delay", "sensor_noise")

    def written(self, changes: ModelChanges, source: bytes) -> WrittenModel:
        """See `ModelExporter`."""
        text = XmlText(source, "robot")
        for joint, change in changes.joints.items():
            element = found_by_name(text.root.children, "joint", joint)
            values = {name: repr(value) for name, value in change.values.items()}
            dynamics = element.child("dynamics")
            if dynamics is not None:
                text.set_attributes(dynamics, values)
            elif values:
                attributes = " ".join(f'{name}="{value}"' for name, value in values.items())
                text.insert_first(element, f"<dynamics {attributes}/>")
        if changes.payload is not None:
            link = found_by_name(text.root.children, "link", changes.payload.link)
            text.put_child(link, urdf_inertial(changes.payload.parameters))
        return WrittenModel(text.changed(changes.remark), changes.left_out)

"""SDFormat (http://sdformat.org/spec?elem=joint): joints, position controllers, sensors and the payload's link."""

from collections.abc import Mapping

from poise.errors import ErrorCode, InputError
from poise.exporting import sdf_inertial
from poise.exporting.models.base import JointChange, ModelChanges, ModelExporter, SensorChange, WrittenModel
from poise.exporting.models.names import found_by_name
from poise.exporting.models.xml_text import XmlElement, XmlText


class SdfModelExporter(ModelExporter):
    """`friction` and `damping` of joints, gains of position controllers; there is no place for rotors and delays."""

    kind = "sdf"
    summary = "SDFormat: joints (friction, damping), gains of controllers, noise of sensors, the payload's link"
    omits = ("armature", "delay", "sensor_turn", "sensor_limit", "sensor_delay")

    def written(self, changes: ModelChanges, source: bytes) -> WrittenModel:
        """See `ModelExporter`."""
        text = XmlText(source, "sdf")
        elements = list(text.root.walk())
        for joint, change in changes.joints.items():
            _put_dynamics(text, elements, joint, change)
        left_out = []
        for joint, drive in changes.drives.items():
            controllers = [each for each in elements if each.name == "plugin" and _text_of(text, each) == joint]
            gains = {"p_gain": drive.gain, "d_gain": drive.rate_gain}
            given = {name: repr(value) for name, value in gains.items() if value is not None}
            if len(controllers) == 1:
                _put_values(text, controllers[0], given)
            elif given:
                left_out.append(f"the gain of the drive of {joint}: the model has no JointPositionController there")
        if changes.sensor is not None:
            _put_noise(text, elements, changes.sensor)
        if changes.payload is not None:
            link = found_by_name(elements, "link", changes.payload.link)
            text.put_child(link, sdf_inertial(changes.payload.parameters))
        said = changes.leaving_out(*left_out)
        return WrittenModel(text.changed(said.remark), said.left_out)


def _put_dynamics(text: XmlText, elements: list[XmlElement], joint: str, change: JointChange) -> None:
    axis = found_by_name(elements, "joint", joint).child("axis")
    if axis is None:
        raise InputError(ErrorCode.BAD_INPUT, f"the joint {joint} of the model has no axis")
    dynamics, values = axis.child("dynamics"), {name: repr(value) for name, value in change.values.items()}
    if dynamics is not None:
        _put_values(text, dynamics, values)
    elif values:
        parts = "".join(f"<{name}>{value}</{name}>" for name, value in values.items())
        text.insert_first(axis, f"<dynamics>{parts}</dynamics>")


def _put_values(text: XmlText, element: XmlElement, values: Mapping[str, str]) -> None:
    """Give an element children with these texts."""
    missing = ""
    for name, value in values.items():
        old = element.child(name)
        if old is None:
            missing += f"<{name}>{value}</{name}>"
        else:
            text.set_text(old, value)
    if missing:
        text.insert_first(element, missing)


def _text_of(text: XmlText, plugin: XmlElement) -> str:
    """The joint of a controller."""
    joint = plugin.child("joint_name")
    return "" if joint is None else text.between(joint).strip()


def _put_noise(text: XmlText, elements: list[XmlElement], sensor: SensorChange) -> None:
    """The noise of each axis of a force-torque sensor; sensors that the model lacks are left."""
    found = [each for each in elements if each.name == "sensor" and each.attributes.get("name") == sensor.frame]
    parts = ""
    for name, size in (("force", sensor.force_noise), ("torque", sensor.torque_noise)):
        if size is not None:
            axes = (f'<{axis}><noise type="gaussian"><stddev>{size!r}</stddev></noise></{axis}>' for axis in "xyz")
            parts += f"<{name}>{''.join(axes)}</{name}>"
    if len(found) != 1 or not parts:
        return
    inside = found[0].child("force_torque")
    if inside is None:
        text.insert_first(found[0], f"<force_torque>{parts}</force_torque>")
    elif inside.child("force") is None and inside.child("torque") is None:
        text.insert_first(inside, parts)

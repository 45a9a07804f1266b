"""URDF (http://wiki.ros.org/urdf/XML/link): a link of its own, or the robot's URDF with the payload in it."""

from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from poise.errors import ErrorCode, InputError
from poise.exporting.base import ExportedPayload, Exporter
from poise.exporting.inertials import urdf_inertial
from poise.inertia import InertialParameters
from poise.robot import RobotModel, parse_urdf, phi_in_link


class UrdfExporter(Exporter):
    """Link and fixed joint; the inertia is about the centre of mass, in the axes of the inertial's origin."""

    kind = "urdf"
    summary = "URDF: a link and the joint that fixes it to the sensor frame"

    def text(self, payload: ExportedPayload) -> str:
        """A robot of two links; copy link and joint into another to attach the payload there."""
        return f"""<?xml version="1.0"?>
<!-- {payload.remark} -->
<robot name="payload">
  <link name={quoteattr(payload.frame_id)}/>
{_link_and_joint("payload", payload)}
</robot>
"""


class UrdfRobotExporter(Exporter):
    """The robot's URDF, unchanged but for a payload link and the fixed joint under the link of the payload's frame."""

    kind = "urdf-robot"
    summary = "URDF: the robot's own, with a payload link and its fixed joint"
    robot = True

    def text(self, payload: ExportedPayload) -> str:
        """The file; the payload's link has a name that the robot does not use."""
        text = _robot_description(self.kind, payload)
        tree = parse_urdf(text)
        used = {*tree.links, *(joint.get("name", "") for joint in ElementTree.fromstring(text.strip()).iter("joint"))}
        names = ("payload", *(f"payload_{number}" for number in range(2, len(used) + 3)))
        free = next(name for name in names if not {name, f"{name}_mount"} & used)
        before, end, after = text.rpartition("</robot>")
        return f"{before}  <!-- {payload.remark} -->\n{_link_and_joint(free, payload)}\n{end}{after}"


class UrdfLinkExporter(Exporter):
    """The robot's URDF with the payload added to the inertial of the link of the payload's frame: for programs that
    want the links they know, and no others.
    """

    kind = "urdf-link"
    summary = "URDF: the robot's own, with the payload added to the inertial of a link"
    robot = True

    def text(self, payload: ExportedPayload) -> str:
        """The file; the link's inertial is that of both, about their common centre of mass, in the link's axes."""
        text = _robot_description(self.kind, payload)
        tree = parse_urdf(text)
        both = payload.parameters
        if payload.frame_id in tree.inertials:
            both = both + InertialParameters.from_phi(phi_in_link(tree.inertials[payload.frame_id]))
        builder = ElementTree.TreeBuilder(insert_comments=True)
        robot = ElementTree.fromstring(text.strip(), ElementTree.XMLParser(target=builder))
        link = next(each for each in robot.iter("link") if each.get("name") == payload.frame_id)
        for old in link.findall("inertial"):
            link.remove(old)
        link.insert(0, ElementTree.Comment(f" {payload.remark} "))
        link.insert(1, ElementTree.fromstring(urdf_inertial(both)))
        return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _robot_description(kind: str, payload: ExportedPayload) -> str:
    """The URDF to write into, checked.

    Raises:
        InputError: ROBOT_DESCRIPTION_MISSING; FRAME_UNKNOWN when the frame is not a link of it; BAD_INPUT when it
            contains a gripper that was weighed too; as `parse_urdf`.
    """
    text, frame = payload.settings.robot_description, payload.frame_id
    if text is None:
        raise InputError(
            ErrorCode.ROBOT_DESCRIPTION_MISSING,
            f"export {kind} writes into the robot's URDF, and the recording has none: give --urdf FILE",
        )
    links = parse_urdf(text).links
    if frame not in links:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN,
            f"export {kind}: the robot description has no link '{frame}'; give --frame with one that is fixed to the"
            f" sensor, of {', '.join(links)}",
        )
    sensor = payload.estimate.frame_id
    beyond = float(RobotModel.from_urdf(text, sensor).load_in_sensor[0]) if sensor in links else 0.0
    if beyond > 0 and payload.settings.gripper is None:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"export {kind}: the robot description has {beyond:.4g} kg beyond {sensor}, which was weighed with the"
            " payload and would count twice: give --gripper urdf to take it off, or --gripper 0,0,0,0 if it is not"
            " mounted",
        )
    return text


def _link_and_joint(name: str, payload: ExportedPayload) -> str:
    return f"""  <link name="{name}">
    {urdf_inertial(payload.parameters)}
  </link>
  <joint name="{name}_mount" type="fixed">
    <parent link={quoteattr(payload.frame_id)}/>
    <child link="{name}"/>
  </joint>"""

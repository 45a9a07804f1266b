"""URDF: a link fixed to the sensor frame (http://wiki.ros.org/urdf/XML/link)."""

from xml.sax.saxutils import quoteattr

from poise.exporting.base import ExportedPayload, Exporter, numbers

_AXES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class UrdfExporter(Exporter):
    """Link and fixed joint; the inertia is about the centre of mass, in the axes of the inertial's origin."""

    kind = "urdf"
    summary = "URDF: a link and the joint that fixes it to the sensor frame"

    def text(self, payload: ExportedPayload) -> str:
        """A robot of two links; copy link and joint into another to attach the payload there."""
        frame = quoteattr(payload.frame_id)
        inertia = " ".join(f'{name}="{value}"' for name, value in zip(_AXES, numbers(payload.six).split(), strict=True))
        return f"""<?xml version="1.0"?>
<!-- {payload.remark} -->
<robot name="payload">
  <link name={frame}/>
  <link name="payload">
    <inertial>
      <origin xyz="{numbers(payload.parameters.com)}" rpy="0 0 0"/>
      <mass value="{payload.parameters.mass!r}"/>
      <inertia {inertia}/>
    </inertial>
  </link>
  <joint name="payload_mount" type="fixed">
    <parent link={frame}/>
    <child link="payload"/>
  </joint>
</robot>
"""

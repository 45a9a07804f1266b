"""SDFormat: a model for Gazebo (http://sdformat.org/spec?elem=link#inertial)."""

from poise.exporting.base import ExportedPayload, Exporter, numbers

_AXES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class SdfExporter(Exporter):
    """Link whose `inertial/pose` is the centre of mass; the inertia is about it, in the axes of that pose."""

    kind = "sdf"
    summary = "SDFormat: a model of one link for Gazebo, in the sensor frame"

    def text(self, payload: ExportedPayload) -> str:
        """A model of one link."""
        inertia = "".join(
            f"<{name}>{value}</{name}>" for name, value in zip(_AXES, numbers(payload.six).split(), strict=True)
        )
        return f"""<?xml version="1.0"?>
<!-- {payload.remark} -->
<sdf version="1.9">
  <model name="payload">
    <link name="payload">
      <inertial>
        <pose>{numbers(payload.parameters.com)} 0 0 0</pose>
        <mass>{payload.parameters.mass!r}</mass>
        <inertia>{inertia}</inertia>
      </inertial>
    </link>
  </model>
</sdf>
"""

"""SDFormat: a model for Gazebo (http://sdformat.org/spec?elem=link#inertial)."""

from poise.exporting.base import ExportedPayload, Exporter
from poise.exporting.inertials import sdf_inertial


class SdfExporter(Exporter):
    """Link whose `inertial/pose` is the centre of mass; the inertia is about it, in the axes of that pose."""

    kind = "sdf"
    summary = "SDFormat: a model of one link for Gazebo, in the sensor frame"

    def text(self, payload: ExportedPayload) -> str:
        """A model of one link."""
        return f"""<?xml version="1.0"?>
<!-- {payload.remark} -->
<sdf version="1.9">
  <model name="payload">
    <link name="payload">
      {sdf_inertial(payload.parameters)}
    </link>
  </model>
</sdf>
"""

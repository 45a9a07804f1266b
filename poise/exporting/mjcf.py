"""MJCF: a body for MuJoCo (https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-inertial)."""

from poise.exporting.base import ExportedPayload, Exporter
from poise.exporting.inertials import mjcf_inertial


class MjcfExporter(Exporter):
    """Body with `fullinertia`."""

    kind = "mjcf"
    summary = "MJCF: a body for MuJoCo, in the sensor frame"

    def text(self, payload: ExportedPayload) -> str:
        """A model of one body; copy the body into the sensor's to attach the payload there."""
        return f"""<!-- {payload.remark} -->
<mujoco model="payload">
  <worldbody>
    <body name="payload">
      {mjcf_inertial(payload.parameters)}
    </body>
  </worldbody>
</mujoco>
"""

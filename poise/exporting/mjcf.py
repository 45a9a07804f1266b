"""MJCF: a body for MuJoCo (https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-inertial)."""

from poise.exporting.base import ExportedPayload, Exporter
from poise.exporting.inertials import numbers


class MjcfExporter(Exporter):
    """Body with `fullinertia`, which is about the centre of mass in the order xx yy zz xy xz yz."""

    kind = "mjcf"
    summary = "MJCF: a body for MuJoCo, in the sensor frame"

    def text(self, payload: ExportedPayload) -> str:
        """A model of one body; copy the body into the sensor's to attach the payload there."""
        return f"""<!-- {payload.remark} -->
<mujoco model="payload">
  <worldbody>
    <body name="payload">
      <inertial pos="{numbers(payload.parameters.com)}" mass="{payload.parameters.mass!r}"
                fullinertia="{numbers(payload.six[[0, 3, 5, 1, 2, 4]])}"/>
    </body>
  </worldbody>
</mujoco>
"""

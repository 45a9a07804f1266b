"""Franka: the arguments of `setLoad` (libfranka `Robot::setLoad`, franka_msgs/srv/SetLoad)."""

import json

from poise.exporting.base import ExportedPayload, Exporter


class FrankaExporter(Exporter):
    """Mass in kg, centre of mass in m in the flange frame, inertia in kg m2 about it, column-major."""

    kind = "franka"
    summary = "Franka: request of franka_msgs/srv/SetLoad, arguments of libfranka's setLoad"
    flange = True

    def text(self, payload: ExportedPayload) -> str:
        """JSON with the field names of the service, as `ros2 service call` takes it."""
        parameters = payload.parameters
        request = {
            "mass": parameters.mass,
            "center_of_mass": parameters.com.tolist(),
            "load_inertia": parameters.inertia.ravel(order="F").tolist(),
        }
        return json.dumps(request, indent=2) + "\n"

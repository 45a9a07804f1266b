"""Franka: `setLoad` (libfranka `Robot::setLoad`, franka_msgs/srv/SetLoad), and Desk's end effector configuration."""

import json

from poise.exporting.base import ExportedPayload, Exporter


class FrankaExporter(Exporter):
    """Mass in kg, centre of mass in m in the flange frame, inertia in kg m2 about it, column-major.

    The load is what the robot carries besides the end effector that is configured in Desk.
    """

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


class FrankaDeskExporter(Exporter):
    """`endeffector-config.json` of an end effector archive (Franka RIDE CLI, "End effector commissioning").

    The transformation of the end effector frame is not a matter of weighing: it is the identity, to be replaced.
    """

    kind = "franka-desk"
    summary = "Franka: endeffector-config.json for Desk, for a gripper or tool that is always mounted"
    flange = True

    def text(self, payload: ExportedPayload) -> str:
        """JSON; matrices are column-major."""
        parameters = payload.parameters
        config = {
            "id": "poise-payload",
            "name": "Payload identified by poise",
            "mass": parameters.mass,
            "centerOfMass": parameters.com.tolist(),
            "inertia": parameters.inertia.ravel(order="F").tolist(),
            "transformation": [float(row == column) for column in range(4) for row in range(4)],
        }
        return json.dumps(config, indent=2) + "\n"

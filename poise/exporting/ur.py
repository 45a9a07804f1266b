"""Universal Robots: URScript `set_target_payload` (script manual, e-Series 5.10 and later), and the ROS 2 driver."""

import json

import numpy as np

from poise.exporting.base import ExportedPayload, Exporter, decimals

_ORDER = [0, 3, 5, 1, 2, 4]
"""xx yy zz xy xz yz of xx xy xz yy yz zz."""


class UrExporter(Exporter):
    """`set_target_payload(m, cog, inertia, transition_time)`: kg; m from the tool mount; kg m2 about the centre of
    gravity, in the axes of the tool flange, in the order Ixx Iyy Izz Ixy Ixz Iyz; s. The payload is all beyond the
    flange. The robot zeroes its own force sensor when it runs.
    """

    kind = "ur"
    summary = "URScript: set_target_payload"
    needs = ("mass", "com")
    flange = True

    def text(self, payload: ExportedPayload) -> str:
        """The line; without the inertia where it was not identified (the robot then takes zero)."""
        arguments = [f"{payload.parameters.mass:.9f}", f"[{decimals(payload.parameters.com)}]"]
        remark = payload.remark
        seconds = payload.settings.transition_time
        if not payload.has_inertia:
            remark += "; the inertia was not identified: the robot takes zero"
        if payload.has_inertia or seconds:
            arguments.append(f"[{decimals(payload.six[_ORDER] if payload.has_inertia else np.zeros(6))}]")
        if seconds:
            arguments.append(f"{seconds:.3f}")
        return f"# {remark}\nset_target_payload({', '.join(arguments)})\n"


class UrDriverExporter(Exporter):
    """Request of ur_msgs/srv/SetPayload, the service `io_and_status_controller/set_payload` of ur_robot_driver (Jazzy).

    Without the six moments the driver takes zero. Releases before them take mass and centre of gravity alone.
    """

    kind = "ur-driver"
    summary = "UR's ROS 2 driver: request of ur_msgs/srv/SetPayload"
    needs = ("mass", "com")
    flange = True

    def text(self, payload: ExportedPayload) -> str:
        """JSON with the field names of the service, as `ros2 service call` takes it."""
        seconds, rest = divmod(round(payload.settings.transition_time * 1e9), 10**9)
        request = {
            "mass": payload.parameters.mass,
            "center_of_gravity": dict(zip("xyz", payload.parameters.com.tolist(), strict=True)),
        }
        if payload.has_inertia:
            names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
            request |= dict(zip(names, payload.six[_ORDER].tolist(), strict=True))
        if payload.settings.transition_time:
            request |= {"transition_time": {"sec": seconds, "nanosec": rest}}
        return json.dumps(request, indent=2) + "\n"

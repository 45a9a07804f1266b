"""Keep a nav2 base under `acceleration_limits`, so that what stands on it neither slips nor topples.

python examples/nav2_limits.py --ros-args -p smoother:=velocity_smoother

Sets max_accel, max_decel, max_velocity and min_velocity of nav2's velocity smoother (dynamic parameters of nav2 Jazzy)
each time the limits change. The first values of the smoother are taken for what the base itself can do. Parameters:
`smoother` (name of its node), `share` (of the limits that is used).

When nothing is known (no publisher of acceleration_limits, an error without limits, an unstable load), the velocity
becomes zero, at `braking` m/s2 and rad/s2. The values are sent again every two seconds, because a smoother that was
started again has its own. It is not done with nav2's speed_limit topic, whose 0 means "no limit".
"""

import contextlib
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile

from poise_msgs.msg import AccelerationLimits

NAMES = ("max_accel", "max_decel", "max_velocity", "min_velocity")
PARTS = (0.6, 0.2, 0.2)
"""Of the limits: for accelerations along a line, for the centrifugal force of turning, for angular acceleration. Loads
that are sustained each alone are sustained together in parts that add up to one, because the set of them is convex."""
_AGAIN = 2.0  # s after which values are sent again, and a service that does not answer is asked again


@dataclass(frozen=True)
class Smoother:
    """x, y and angle: m/s2, rad/s2, m/s, rad/s. Decelerations and least velocities are negative."""

    max_accel: tuple[float, ...]
    max_decel: tuple[float, ...]
    max_velocity: tuple[float, ...]
    min_velocity: tuple[float, ...]


def standstill(base: Smoother, braking: float) -> Smoother:
    """Velocity zero, reached gently."""
    slow = tuple(min(braking, most) for most in base.max_accel)
    return Smoother(slow, tuple(-a for a in slow), (0.0,) * 3, (0.0,) * 3)


def within(limits: AccelerationLimits, base: Smoother, share: float) -> Smoother | None:
    """What the base may do so that every acceleration of the load stays inside the limits; None: it must stand.

    Accelerations along x and y, and the centripetal acceleration v w along y, share the facets
    `normals[i] . a <= offsets[i]`.

    Args:
        limits: of the load, in the frame of the base.
        base: what the base can do.
        share: of the limits that is used.
    """
    if limits.error.code not in (limits.error.OK, limits.error.DEADLINE) or not limits.offsets:
        return None
    line, turning, angular = (share * part for part in PARTS)
    accel, decel = np.array(base.max_accel), -np.array(base.max_decel)
    speed = np.maximum(np.abs(base.max_velocity), np.abs(base.min_velocity))
    most = np.maximum(accel, decel)[:2]
    sideways = math.hypot(speed[0], speed[1]) * speed[2]
    normals = np.abs([[normal.x, normal.y] for normal in limits.normals])
    needed = normals @ most + np.linalg.norm(normals, axis=1) * sideways
    offsets = np.array(limits.offsets)
    if not np.isfinite([*offsets, *needed, limits.angular_acceleration, limits.angular_speed]).all():
        return None
    limiting = needed > 0
    scale = float(np.min(line * offsets[limiting] / needed[limiting], initial=1.0))
    turn = min(1.0, angular * limits.angular_acceleration / max(accel[2], decel[2])) if max(accel[2], decel[2]) else 1.0
    spin = min(1.0, math.sqrt(turning) * limits.angular_speed / speed[2]) if speed[2] else 1.0
    if not min(scale, turn, spin) > 0.0:
        return None
    factors = np.array([scale, scale, turn])
    # v w falls with the square of both.
    slower = np.array([math.sqrt(scale), math.sqrt(scale), min(math.sqrt(scale), spin)])

    def rounded(values: Sequence[float]) -> tuple[float, ...]:
        return tuple(float(value) for value in values)

    return Smoother(
        rounded(factors * accel),
        rounded(-factors * decel),
        rounded(slower * np.array(base.max_velocity)),
        rounded(slower * np.array(base.min_velocity)),
    )


class Nav2Limits(Node):
    """Asks the smoother what the base can do, then keeps it under the limits."""

    def __init__(self, **options: object) -> None:
        super().__init__("nav2_limits", **options)
        name = self.declare_parameter("smoother", "velocity_smoother").value
        self._share = self.declare_parameter("share", 0.8).value
        self._braking = self.declare_parameter("braking", 0.1).value
        if not 0.0 < self._share <= 1.0 or not self._braking > 0.0:
            raise ValueError("share must be above 0 and at most 1, braking above 0")
        self._get = self.create_client(GetParameters, f"{name}/get_parameters")
        self._set = self.create_client(SetParametersAtomically, f"{name}/set_parameters_atomically")
        self._base: Smoother | None = None
        self._limits: AccelerationLimits | None = None
        self._sent: Smoother | None = None
        self._asked, self._asked_at = None, -math.inf
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(AccelerationLimits, "acceleration_limits", self._hear, latched)
        self.create_timer(0.1, self._tick)

    def _hear(self, message: AccelerationLimits) -> None:
        self._limits = message

    def _tick(self) -> None:
        late = time.monotonic() - self._asked_at > _AGAIN
        if self._asked is not None and not self._asked.done():
            if late:  # its server has gone: it may never answer
                self._asked = self._sent = None
            return
        if self._base is None:
            self._ask_base()
            return
        if self._asked is not None and not self._asked.result().result.successful:
            self.get_logger().error(f"the smoother refuses: {self._asked.result().result.reason}")
            self._sent = None  # again
        self._asked = None
        known = self._limits is not None and self.count_publishers("acceleration_limits") > 0
        wanted = within(self._limits, self._base, self._share) if known else None
        wanted = wanted or standstill(self._base, self._braking)
        if (late or wanted != self._sent) and self._set.service_is_ready():
            values = [Parameter(name, value=list(getattr(wanted, name))).to_parameter_msg() for name in NAMES]
            self._asked = self._set.call_async(SetParametersAtomically.Request(parameters=values))
            self._asked_at = time.monotonic()
            if wanted != self._sent:
                self.get_logger().info(f"accelerations to {wanted.max_accel}, velocities to {wanted.max_velocity}")
            self._sent = wanted

    def _ask_base(self) -> None:
        if self._asked is None:
            if self._get.service_is_ready():
                self._asked, self._asked_at = self._get.call_async(GetParameters.Request(names=NAMES)), time.monotonic()
            return
        values = [tuple(value.double_array_value) for value in self._asked.result().values]
        self._asked = None
        if [len(value) for value in values] == [3] * len(NAMES):
            self._base = Smoother(*values)
        else:
            self.get_logger().error(f"the smoother lacks {', '.join(NAMES)} with three numbers each")


def main() -> None:
    """Run until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.init()
        rclpy.spin(Nav2Limits())


if __name__ == "__main__":
    main()

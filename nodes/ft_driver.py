"""Lifecycle node: a force-torque sensor's samples as WrenchStamped, with diagnostics and a bias service."""

import array

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from poise.errors import PoiseError
from poise.force_torque import Acquisition, BlockAverages, SampleBatch, Severity, StreamReport
from poise.nodes.diagnostics import DiagnosticsPublisher
from poise.nodes.ft_driver_parameters import FT_DRIVER_PARAMETERS, DriverSetup, read_parameters
from poise.nodes.lifecycle import ManagedNode
from poise.nodes.parameters import declare_parameters
from poise.nodes.runtime import guarded, publish, run
from poise_msgs.msg import WrenchBatch

WRENCH_QOS = QoSProfile(depth=1000)
"""Reliable, with a second of history at 1 kHz: a reader that is held up for less than that misses nothing. Readers
with SensorDataQoS (best effort) match as well; they get what is newest and may miss some."""
_BATCH_QOS = QoSProfile(depth=100)
_BIAS_PATIENCE = 3.0
"""s that a bias may take beyond the time of its samples at 100 Hz."""


class FtDriver(ManagedNode):
    """Reads one sensor while active. Parameters are taken in on_configure; the fault contract is in docs/ft_driver.md.

    The samples arrive in the acquisition's thread, which publishes them itself: handing them to the executor first
    would add a wake-up to every message. Everything else runs in the executor.
    """

    def __init__(self) -> None:
        super().__init__("ft_driver")
        declare_parameters(
            self, FT_DRIVER_PARAMETERS, changeable=[parameter.name for parameter in FT_DRIVER_PARAMETERS]
        )
        self.add_on_set_parameters_callback(self._accept_parameters)
        self._setup: DriverSetup | None = None
        self._publisher: SamplePublisher | None = None
        self._acquisition: Acquisition | None = None
        self.start()

    def start(self) -> None:
        """Configure and activate, when `autostart` says so.

        Raises:
            InputError: when the parameters cannot be used.
        """
        if self.get_parameter("autostart").value:
            read_parameters(self)  # here an error still ends the process with its reason
        super().start()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            self._setup = read_parameters(self)
        except PoiseError as error:
            self.get_logger().error(f"{error.code.name}: {error.message}")
            return TransitionCallbackReturn.FAILURE
        self._publisher = SamplePublisher(self, self._setup.frame_id)
        self._service = self.create_service(Trigger, "bias_sensor", self._bias_sensor)
        self._idle_timer = self.create_timer(1.0, guarded(self, self._report_idle))
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        result = super().on_activate(state)
        self._acquisition = Acquisition(self._setup.link, self._setup.options, self._publisher, np.random.default_rng())
        self._acquisition.start()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._stop()
        self._release()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._stop()
        self._release()
        return TransitionCallbackReturn.SUCCESS  # to unconfigured, from where it can be tried again

    def destroy_node(self) -> None:
        """Stop the device's stream before the node is destroyed."""
        self._stop()
        super().destroy_node()

    def _stop(self) -> None:
        acquisition, self._acquisition = self._acquisition, None
        if acquisition is not None and not acquisition.stop() and rclpy.ok():
            self.get_logger().warning("the acquisition hangs in a system call; it ends when that returns")

    def _release(self) -> None:
        if self._publisher is None:
            return
        self.destroy_timer(self._idle_timer)
        self.destroy_service(self._service)
        self._publisher.destroy()
        self._publisher = self._setup = None

    def _accept_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Refuse what would have no effect."""
        if self._setup is None:
            return SetParametersResult(successful=True)
        return SetParametersResult(
            successful=False, reason="parameters are taken in when the driver is configured: deactivate, clean up, set"
        )

    def _report_idle(self) -> None:
        if self._acquisition is None and self._publisher is not None:
            self._publisher.report_idle(self._setup.link.name)

    def _bias_sensor(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Make the present load the zero; other requests wait meanwhile, the samples do not."""
        if self._acquisition is None:
            response.message = "the driver is not active: activate it first"
            return response
        count = self._setup.bias_samples
        try:
            bias = self._acquisition.zero(count, count / 100.0 + _BIAS_PATIENCE, self._setup.hardware_bias)
        except PoiseError as error:
            response.message = f"{error.code.name}: {error.message}"
            return response
        response.success = True
        response.message = (
            f"bias {np.array2string(bias.wrench_in_sensor, precision=4)} from {bias.count} samples, "
            f"standard deviation {np.array2string(bias.spread, precision=4)} (N, N m)"
        )
        return response


class SamplePublisher:
    """The sink of the acquisition: messages out.

    Args:
        node: that publishes.
        frame_id: of the sensor.
    """

    def __init__(self, node: LifecycleNode, frame_id: str) -> None:
        self._node = node
        self._kind = ""
        self._wrench = node.create_lifecycle_publisher(WrenchStamped, "wrench", WRENCH_QOS)
        self._batch = node.create_lifecycle_publisher(WrenchBatch, "wrench_batch", _BATCH_QOS)
        self._diagnostics = DiagnosticsPublisher(node, "force-torque sensor")
        # One message of each kind, filled again for every publish(), which has serialised it when it returns.
        self._wrench_message = WrenchStamped()
        self._wrench_message.header.frame_id = frame_id
        self._batch_message = WrenchBatch()
        self._batch_message.header.frame_id = frame_id

    def destroy(self) -> None:
        self._node.destroy_lifecycle_publisher(self._wrench)
        self._node.destroy_lifecycle_publisher(self._batch)
        self._diagnostics.destroy()

    def blocks(self, blocks: BlockAverages) -> None:
        message = self._wrench_message
        stamp, force, torque = message.header.stamp, message.wrench.force, message.wrench.torque
        for time, wrench in zip(blocks.stamps.tolist(), blocks.wrench_in_sensor.tolist(), strict=True):
            stamp.sec, stamp.nanosec = divmod(time, 1_000_000_000)
            force.x, force.y, force.z, torque.x, torque.y, torque.z = wrench
            publish(self._wrench, message)

    def batch(self, batch: SampleBatch) -> None:
        message = self._batch_message
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(batch.stamp, 1_000_000_000)
        message.period = batch.period
        # From array.array the fields are copied at once, from numpy element by element.
        message.sequence = array.array("I", batch.sequence.tobytes())
        message.wrench = array.array("f", batch.wrench_in_sensor.astype(np.float32).tobytes())
        message.status = array.array("I", batch.status.tobytes())
        message.received, message.lost, message.out_of_order = batch.received, batch.lost, batch.out_of_order
        publish(self._batch, message)

    def report(self, report: StreamReport) -> None:
        condition = report.condition
        name = f"{condition.code.name}: " if condition.code else ""
        values = {
            "condition": condition.kind,
            "received": report.received,
            "lost": report.lost,
            "out_of_order": report.out_of_order,
            "duplicates": report.duplicates,
            "restarts": report.restarts,
            "rejected": report.rejected,
            "withheld": report.withheld,
            "connects": report.connects,
            "rate_hz": f"{report.rate:.1f}",
            "age_s": "" if report.age is None else f"{report.age:.3f}",
            "status": f"{report.status:#010x} {report.status_text}",
            "bias": " ".join(f"{value:.6g}" for value in report.bias),
        }
        self._diagnostics.publish(condition.severity, name + condition.text, values, report.device)
        if condition.kind != self._kind:
            self._kind = condition.kind
            logger = self._node.get_logger()
            # One call site per severity: rclpy refuses a site that changes its own.
            if condition.severity is Severity.ERROR:
                logger.error(f"{report.device}: {name}{condition.text}")
            elif condition.severity is Severity.WARN:
                logger.warning(f"{report.device}: {name}{condition.text}")
            else:
                logger.info(f"{report.device}: {condition.text}")

    def report_idle(self, device: str) -> None:
        """Report that the driver is inactive on purpose."""
        self._diagnostics.publish(Severity.OK, "inactive", {"condition": "inactive"}, device)


def main() -> None:
    """Run until Ctrl-C."""
    run(FtDriver)


if __name__ == "__main__":
    main()

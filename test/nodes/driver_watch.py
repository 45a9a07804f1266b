"""What the tests of ft_driver share: parameters for a fake sensor, and an eye on the diagnostics."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from ros_graph import Graph

from poise.force_torque.sensors.ati_rdt.fake import FakeRdtSensor


def rdt_parameters(sensor: FakeRdtSensor, **more: Any) -> dict[str, Any]:
    return {"address": "127.0.0.1", "port": sensor.port, "http_port": sensor.http_port, **more}


class Diagnostics:
    """The driver's diagnostics as they come."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._messages = graph.collect("/diagnostics", DiagnosticArray)

    @property
    def conditions(self) -> list[str]:
        return [self.values(message)["condition"] for message in self._messages]

    @property
    def last(self) -> Any:
        return self._messages[-1].status[0]

    @staticmethod
    def values(message: DiagnosticArray) -> dict[str, str]:
        return {pair.key: pair.value for pair in message.status[0].values}

    def wait_for(self, condition: str, after: int = 0) -> dict[str, str]:
        """The values of the first message from number `after` on that has this condition."""
        self._graph.wait_for(lambda: condition in self.conditions[after:], what=f"{condition} in diagnostics")
        return self.values(self._messages[self.conditions.index(condition, after)])

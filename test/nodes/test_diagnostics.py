"""Diagnostics in a namespace are where the aggregator reads; limits of the diagnoser change while it runs."""

import math

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Wrench
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

pytestmark = pytest.mark.ros


def test_a_diagnoser_in_a_namespace_is_diagnosed_and_can_be_limited_while_it_runs(graph, start_node):
    states = graph.collect("/diagnostics", DiagnosticArray)
    start_node("mismatch_diagnoser", {"wrench": "required"}, remaps={"__ns": "/robot1"})
    graph.wait_for(lambda: states, what="diagnostics")
    assert states[0].status[0].name == "robot1/mismatch_diagnoser"
    assert states[0].status[0].message.startswith("no wrench has come yet")
    other = Context()  # one participant of DDS has one type for a name
    rclpy.init(context=other, domain_id=graph.domain)
    driver = Node("driver", context=other)
    driver.create_publisher(Wrench, "/robot1/wrench", 10)
    hint = "/robot1/wrench carries geometry_msgs/msg/Wrench, not geometry_msgs/msg/WrenchStamped"
    graph.wait_for(lambda: hint in states[-1].status[0].message, what="the type of the other publisher")
    client = graph.node.create_client(SetParameters, "/robot1/mismatch_diagnoser/set_parameters")
    graph.wait_for(client.service_is_ready, what="the parameters")
    values = {"period": 2.0, "share": math.nan, "deadline": math.inf, "window": 9.0}
    changes = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    future = client.call_async(SetParameters.Request(parameters=changes))
    graph.wait_for(future.done, what="the answer")
    assert [result.successful for result in future.result().results] == [True, False, False, False]
    driver.destroy_node()
    rclpy.shutdown(context=other)

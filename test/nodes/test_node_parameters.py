"""Parameters: dynamic ones follow their changes within their ranges, the others stay; a node ends quietly at once."""

import math
import signal
import subprocess
import sys

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from poise.nodes import acceleration_limits, identify_payload, object_scanner_parameters, place_execution
from poise.nodes.parameters import Parameter, declare_parameters
from poise.nodes.placement_planner import PLACEMENT_PLANNER_PARAMETERS
from poise.nodes.robustness_server_parameters import ROBUSTNESS_SERVER_PARAMETERS

pytestmark = pytest.mark.ros


@pytest.fixture
def node(domain):
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node("parameters_under_test", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_dynamic_parameters_follow_and_the_others_stay(node):
    values = declare_parameters(
        node,
        (
            Parameter("count", 3, "a number", (1, 10), dynamic=True),
            Parameter("seconds", 1.0, "a time, s", (0.1, 10.0), dynamic=True),
            Parameter("check", True, "a switch", dynamic=True),
            Parameter("limit", 0.5, "of the arm, m/s", (0.0, 1.0)),
        ),
    )
    asked = {"count": 4, "seconds": 2.0, "check": False, "limit": 0.9}
    results = node.set_parameters([RosParameter(name, value=value) for name, value in asked.items()])
    assert [result.successful for result in results] == [True, True, True, False]
    assert values == {**asked, "limit": 0.5}
    for name, value in (("count", 11), ("count", 2.0), ("seconds", math.nan), ("seconds", math.inf), ("check", "yes")):
        assert not node.set_parameters([RosParameter(name, value=value)])[0].successful
    assert values == {**asked, "limit": 0.5}


def test_a_dynamic_parameter_is_a_switch_or_a_number_with_a_range():
    tables = (
        acceleration_limits.ACCELERATION_LIMITS_PARAMETERS,
        identify_payload.IDENTIFY_PAYLOAD_PARAMETERS,
        object_scanner_parameters.SCANNER_PARAMETERS,
        place_execution.PLACE_EXECUTION_PARAMETERS,
        PLACEMENT_PLANNER_PARAMETERS,
        ROBUSTNESS_SERVER_PARAMETERS,
    )
    for table in tables:
        dynamic = [one for one in table if one.dynamic]
        assert dynamic
        assert all(isinstance(one.default, bool) or len(one.choices) == 2 for one in dynamic)


@pytest.mark.parametrize(
    ("program", "package", "status"),
    [
        ("/bin/robustness_server", "poise.nodes", -signal.SIGINT),
        ("/bin/fake_robot", "poise.fake_robots", -signal.SIGINT),
        ("/home/user/program.py", "poise.nodes", 7),
    ],
)
def test_ctrl_c_while_a_node_imports_ends_it_without_a_traceback(program, package, status):
    code = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # else a test run in the background ignores it
        f"sys.argv = [{program!r}]\nimport {package}\n"
        "try:\n    os.kill(os.getpid(), signal.SIGINT)\nexcept KeyboardInterrupt:\n    sys.exit(7)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (status, b"")

"""docs/robustness_server.md: the client on the page works, and the parameter files are the defaults of the nodes."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from poise.nodes import acceleration_limits, object_carrier, place_execution, placement_planner, robustness_server
from poise.nodes.arm_node import ARM_NODE_PARAMETERS
from poise.nodes.parameters import AUTOSTART, WORDS

pytestmark = pytest.mark.ros
ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "robustness_server.md").read_text()


def test_the_client_on_the_page_is_answered(start_node, graph, node_environment):
    start_node("robustness_server", {"scene": str(ROOT / "docs" / "scenes" / "tray.yaml")})
    graph.wait_for(lambda: graph.node.count_publishers("assembly"), what="the server")
    (example,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    environment = node_environment | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", example]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    # The parcel, with the can on it, slides at mu g (1 + 0.4) kg.
    assert done.stdout == "parcel, can would move at 6.87 N (at least 6.87 N)\n"


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("robustness_server", robustness_server.ROBUSTNESS_SERVER_PARAMETERS),
        ("acceleration_limits", acceleration_limits.ACCELERATION_LIMITS_PARAMETERS),
        (
            "placement_planner",
            placement_planner.PLACEMENT_PLANNER_PARAMETERS
            + place_execution.PLACE_EXECUTION_PARAMETERS
            + ARM_NODE_PARAMETERS,
        ),
        ("object_carrier", (*object_carrier.OBJECT_CARRIER_PARAMETERS, AUTOSTART)),
    ],
)
def test_the_parameter_file_holds_every_default(name, parameters):
    content = yaml.safe_load((ROOT / "config" / f"{name}.yaml").read_text())
    values = content["/**"][name]["ros__parameters"]
    assert values == {p.name: [] if p.default is WORDS else p.default for p in parameters}

"""The SROS 2 policies allow what each running node uses, and nothing else.

The wheels of Fast DDS from PyPI are built without security, so that no test can run nodes with it enforced: this one
compares the policy files with the graph.
"""

from pathlib import Path

import pytest
from rclpy.action import ActionClient
from rclpy.action.graph import (
    get_action_client_names_and_types_by_node,
    get_action_server_names_and_types_by_node,
)

from poise.keystore import NodePolicy, read_policy
from poise_msgs.action import ScanObject

pytestmark = pytest.mark.ros
ROOT = Path(__file__).parents[2]
POLICIES = sorted((ROOT / "config" / "sros2").glob("*.policy.xml"))
PARAMETERS = {
    "acceleration_limits": {"payload": "can", "from_odom": True},
    "fake_robot": {
        "mode": "arm",
        "robot": "ridgeback_ur10",
        "publish_clock": True,
        "gripper_joint": "finger_joint",
        "world": str(ROOT / "docs" / "scenes" / "tray.yaml"),
        "camera": True,
    },
    "ft_driver": {"address": "127.0.0.1", "batch_rate": 10.0},
    "loop": {"ready_timeout": 3600.0, "world": str(ROOT / "docs" / "scenes" / "tray.yaml")},
    "object_scanner": {"patience": 300.0},
    "robustness_server": {"poses_from_tf": True},
}
"""With these, a node makes every interface that it has."""
WHILE_MOVING = {
    "inertial_estimator_watchdog": {"/joint_states", "/wrench"},
    "object_picker": {"/joint_states"},
    "object_picker_watchdog": {"/joint_states", "/wrench"},
    "object_scanner_watchdog": {"/joint_states", "/wrench"},
    "placement_planner": {"/joint_states"},
    "placement_planner_watchdog": {"/joint_states", "/wrench"},
}
"""Topics that a node subscribes to only while it moves an arm."""
SIM_TIME = "/clock"
"""Allowed for every node: only those with use_sim_time subscribe to it."""


def used_by(graph, name: str) -> NodePolicy:
    """What a running node has made in the graph."""
    node = graph.node

    def names(found):
        return frozenset(topic for topic, _ in found if "/_action/" not in topic)

    served = get_action_server_names_and_types_by_node(node, name, "/")
    called = get_action_client_names_and_types_by_node(node, name, "/")
    allowed = {
        ("topic", "publish"): names(node.get_publisher_names_and_types_by_node(name, "/")),
        ("topic", "subscribe"): names(node.get_subscriber_names_and_types_by_node(name, "/"))
        | WHILE_MOVING.get(name, set())
        | {SIM_TIME},
        ("service", "reply"): names(node.get_service_names_and_types_by_node(name, "/")),
        ("service", "request"): names(node.get_client_names_and_types_by_node(name, "/")),
        ("action", "execute"): frozenset(action for action, _ in served),
        ("action", "call"): frozenset(action for action, _ in called),
    }
    return NodePolicy(name, "/", {key: value for key, value in allowed.items() if value})


def test_the_policy_of_each_node_is_what_it_uses(start_node, graph) -> None:
    for path in POLICIES:
        name = path.name.partition(".")[0]
        start_node(name, PARAMETERS.get(name, {}))
    expected = {path: read_policy(path) for path in POLICIES}
    all_names = {policy.node for policies in expected.values() for one in policies.values() for policy in one}
    graph.wait_for(lambda: all_names <= set(graph.node.get_node_names()), what="every node")
    client = ActionClient(graph.node, ScanObject, "scan_object")
    graph.wait_for(client.server_is_ready, what="scan_object")
    client.send_goal_async(ScanObject.Goal(id="cup", stationary=True))  # it subscribes to the camera

    def differences() -> list[str]:
        found = []
        for policy in (one for policies in expected.values() for enclave in policies.values() for one in enclave):
            seen = used_by(graph, policy.node).allowed
            for key in {*seen, *policy.allowed}:
                allowed, used = policy.allowed.get(key, frozenset()), seen.get(key, frozenset())
                if allowed != used:
                    found.append(
                        f"{policy.node} {key}: unused {sorted(allowed - used)}, denied {sorted(used - allowed)}"
                    )
        return found

    try:
        graph.wait_for(lambda: not differences())
    except pytest.fail.Exception:
        pytest.fail("\n".join(differences()))
    finally:
        client.destroy()

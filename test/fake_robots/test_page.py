"""docs/fake_robots.md and the parameter files: every example is one that works."""

import re
import shlex
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from poise.fake_robots.faults import parse_faults
from poise.fake_robots.parameters import PARAMETERS, PAYLOAD, make_source
from poise.nodes.parameters import declare_parameters
from poise.robot import RobotModel
from poise.simulation import check_limits, read_trajectory

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "fake_robots.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


COMMANDS = [line for block in blocks("sh") for line in block.splitlines() if "fake_robot" in line]
FILES = sorted((ROOT / "config").glob("fake_robot*.yaml"))
COMMANDS += [f"--ros-args --params-file config/{path.name}" for path in FILES]


@pytest.fixture(scope="module")
def context():
    context = Context()
    rclpy.init(context=context)
    yield context
    rclpy.shutdown(context=context)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_starts_a_robot_with_something_to_say(command, context, monkeypatch):
    monkeypatch.chdir(ROOT)
    words = shlex.split(command)
    arguments = words[words.index("--ros-args") :]
    node = Node("fake_robot", context=context, cli_args=arguments, start_parameter_services=False)
    try:
        values = declare_parameters(node, PARAMETERS, PAYLOAD)
        parse_faults(values["faults"])
        source = make_source(values)
    finally:
        node.destroy_node()
    said = {message.topic for message, _ in zip(source.messages(), range(200), strict=False)}
    assert "wrench" in said


def test_the_trajectory_file_is_one(tmp_path):
    (text,) = blocks("yaml")
    (tmp_path / "stops.yaml").write_text(text)
    model = RobotModel.from_file("fr3")
    check_limits(model, read_trajectory(tmp_path / "stops.yaml", model))

"""What the package says of itself: its ROS dependencies, and the files that its pages name."""

import ast
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOT_ROS = {"numpy", "poise", "pymodbus", "scipy", "serial", "yaml"}
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), ROOT / "bags" / "README.md"])


def imported(file: Path) -> set[str]:
    """Top names of the modules that a file imports."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


def test_every_ros_package_that_a_node_or_launch_file_imports_is_in_package_xml() -> None:
    files = [file for room in ("nodes", "fake_robots", "launch") for file in (ROOT / room).rglob("*.py")]
    wanted = set().union(*map(imported, files)) - set(sys.stdlib_module_names) - NOT_ROS
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    named = {element.text for tag in ("depend", "exec_depend") for element in package.iter(tag)}
    assert "rclpy" in wanted
    assert wanted <= named, wanted - named


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_files_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text()
    links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if not link.startswith("http")]
    for link in filter(None, links):
        assert (page.parent / link).exists(), link
    for name in re.findall(
        r"`((?:test|nodes|config|launch|tools|msg_defs|bags)/[\w./-]+\.(?:py|yaml|mcap|sh|msg|md))`", text
    ):
        assert (ROOT / name).exists(), name

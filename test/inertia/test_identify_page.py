"""docs/identify.md: the fields, reasons and defaults that it lists are those of the code."""

import json
import re
import shutil
from pathlib import Path

import pytest
import yaml

from poise.cli import run
from poise.inertia.bayes import estimator
from poise.inertia.model import sample_checks, spikes
from poise.inertia.pipeline import segments
from poise.robot import motion_buffers as tracks
from poise.robot.motion_buffers import PairingSettings

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "identify.md").read_text(encoding="utf-8")


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A folder with the bags in it, as a reader of the page has."""
    shutil.copytree(ROOT / "bags", tmp_path / "bags")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_field_of_the_json_is_on_the_page_and_the_other_way_round(here, capsys):
    assert run(["identify", "bags/kuka_static_poses.mcap", "--json", "-"]) == 0
    section = PAGE.split("## JSON")[1].split("## ")[0]
    left = "\n".join(line.split("|")[1] for line in section.splitlines() if line.startswith("| `"))
    assert set(re.findall(r"`(\w+)`", left)) == set(json.loads(capsys.readouterr().out))


def test_every_reason_is_on_the_page():
    section = PAGE.split("## Rejected samples")[1].split("## ")[0]
    named = set(re.findall(r"^\| `(\w+)`", section, re.MULTILINE))
    assert named == {
        sample_checks.NOT_FINITE,
        sample_checks.SATURATED,
        spikes.SPIKE,
        sample_checks.OUT_OF_ORDER,
        tracks.MOVING,
        tracks.NO_KINEMATICS,
        tracks.STALE,
        estimator.EXTERNAL_CONTACT,
        segments.PAYLOAD_CHANGE,
    }


def test_the_numbers_of_the_page_are_the_defaults():
    settings = PairingSettings()
    assert f"{settings.rest_turning} rad/s" in PAGE
    assert f"{settings.rest_speed * 100:.0f} cm/s within {settings.rest_window} s" in PAGE
    assert f"gap of more than {settings.max_gap} s ({settings.rest_gap:.0f} s between equal poses)" in PAGE
    assert f"within {settings.edge} s of one" in PAGE
    assert f"up to {settings.block + settings.margin + settings.edge:.1f} s for `ols`" in PAGE
    written = yaml.safe_load((ROOT / "config" / "inertial_estimator.yaml").read_text())
    (parameters,) = (node["inertial_estimator"]["ros__parameters"] for node in written.values())
    for name in ("max_gap", "rest_gap", "rest_window", "rest_turning", "rest_speed", "block", "margin"):
        assert parameters[name] == getattr(settings, name)

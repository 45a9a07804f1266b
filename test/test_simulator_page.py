"""docs/simulator.md: its blocks run, and the files that they write hold what the example's robot has."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pages import ROOT
from test_pages import reader as reader
from test_pages import run_page


def test_the_example_comes_closer_and_the_file_says_what_it_lacks(
    reader: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Friction, payload, drives: MuJoCo reads them from the exported file."""
    run_page(ROOT / "docs" / "simulator.md", reader, capsys)
    answer, values = (json.loads((reader / name).read_text()) for name in ("found.json", "values.json"))
    text = (reader / "arm_found.xml").read_text()
    model = mujoco.MjModel.from_xml_path(str(reader / "arm_found.xml"))
    assert model.dof_frictionloss.tolist() == pytest.approx([1.4, 1.8, 0.9], rel=0.1)
    assert model.body("held").mass[0] == pytest.approx(1.3, rel=0.03)
    assert model.actuator_gainprm[:, 0].tolist() == pytest.approx([220.0] * 3, rel=0.02)
    assert model.actuator_delay.tolist() == pytest.approx([0.012] * 3, abs=0.002)
    assert values["isaac_lab"]["stiffness"]["turn"] == pytest.approx(220.0, rel=0.02)
    assert values["usd"]["turn"]["drive:angular:physics:stiffness"] == pytest.approx(220.0 * np.pi / 180, rel=0.02)
    assert values["ros2_control"]["gains"]["turn"]["d"] == pytest.approx(12.0, rel=0.05)
    assert values["sensor"]["noise"]["force"] == pytest.approx(0.05, rel=0.2)
    assert [each["kept"] for each in answer["drives"]] == [True] * 3
    lacking = answer["exports"][0]["not_written"]
    assert any("asymmetry" in each for each in lacking)
    assert all(f"not written: {each}" in text for each in lacking)
    assert text.startswith((ROOT / "examples" / "simulator" / "arm.xml").read_text().splitlines()[0])

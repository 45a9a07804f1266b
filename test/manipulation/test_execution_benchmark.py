"""A fast slice of benchmarks/execution.py: two objects, planned, played by the fake FR3, let go of in MuJoCo."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_two_objects_are_placed_and_every_step_is_counted(tmp_path):
    pytest.importorskip("mujoco")
    command = [sys.executable, "-m", "benchmarks.execution", "--quick", "--out", str(tmp_path / "found.json")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "found.json").read_text())
    assert set(found) == {"with the arm in mind", "pose first"}
    for outcomes in found.values():
        assert len(outcomes) == 2
        assert all(one["planning"] > 0 for one in outcomes)
        assert all(one["failed"] is None or one["why"] for one in outcomes)
    assert "placement execution" in done.stdout

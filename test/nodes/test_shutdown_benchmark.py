"""A fast slice of benchmarks/shutdown.py: every node, two ways of being stopped each."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_every_node_ends_cleanly_when_it_is_stopped(domain: int, tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "benchmarks" / "shutdown.py", "--quick", "--domain", str(domain)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

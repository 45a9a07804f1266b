"""The examples of docs/recording.md run."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_examples_of_the_recording_page_run(tmp_path):
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    (tmp_path / "out").mkdir()
    text = (ROOT / "docs" / "recording.md").read_text()
    examples = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(examples) == 4
    script = tmp_path / "examples.py"
    script.write_text("\n".join([*examples, "print(gravity, sum(reason == 0), len(matched))"]))
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "of 4376 wrenches; cut.mcap: the chunk at byte" in done.stdout
    gravity, placed, matched = done.stdout.splitlines()[-1].split()
    assert gravity == "9.82085"
    assert int(placed) > 4300, "tf reaches over nearly all of the recording"
    assert int(matched) > 4000

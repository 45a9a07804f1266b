"""Memory of freed arrays is kept for the next ones."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
CODE = """if True:
    import resource, sys
    import numpy
    from poise.memory import keep_freed_memory

    if sys.argv[1] == "kept":
        keep_freed_memory()
    for _ in range(6):
        numpy.ones(5_000_000)  # 40 MB: a mapping of its own by default
        faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        print(faults)
"""


def faults_of_the_last(which: str) -> int:
    """Page faults of the last of six arrays that come and go."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "NUMPY_MADVISE_HUGEPAGE": "0"}
    command = [sys.executable, "-c", CODE, which]
    printed = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split()
    return int(printed[-1]) - int(printed[-2])


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries keep their way")
def test_pages_of_freed_arrays_are_not_cleared_again() -> None:
    assert faults_of_the_last("default") > 5000
    assert faults_of_the_last("kept") < 100

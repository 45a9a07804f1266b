"""Settings of the whole suite: tests import the benchmarks, and CI has every independent engine."""

import gc
import importlib.util
import os
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

# Before numpy: threads of OpenBLAS that wait for each other take several times the CPU, most of all on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parents[1]))  # benchmarks/ is not installed

ENGINES = ("mujoco", "pybullet")
"""Engines that check Poise's own physics; tests that use them are skipped where they are missing, but never in CI."""


def pytest_configure() -> None:
    """Refuse to start in CI without an engine."""
    missing = [name for name in ENGINES if importlib.util.find_spec(name) is None]
    if os.environ.get("CI") == "true" and missing:
        raise pytest.UsageError(f"CI has to run every test: pip install {' '.join(missing)} (extra [test])")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep the modules and tests from the collector of cycles: they stay, and each full search would visit them all."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()

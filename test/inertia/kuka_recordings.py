"""The committed recordings of a real arm, each weighed once for all tests of a run."""

from functools import cache
from pathlib import Path

from poise.inertia import Identification, identify
from poise.recording import open_recording

BAGS = Path(__file__).parents[2] / "bags"


@cache
def kuka(name: str) -> Identification:
    """The default answer for kuka_NAME.mcap."""
    return identify(open_recording(BAGS / f"kuka_{name}.mcap"))

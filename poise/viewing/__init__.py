"""Draws results for people: an HTML report, a Rerun recording, and the figures of both. No node needs it."""

from poise.viewing.report import write_identification_report
from poise.viewing.rerun_scene import write_identification_recording

__all__ = ["write_identification_recording", "write_identification_report"]

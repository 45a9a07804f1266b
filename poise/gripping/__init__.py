"""Grippers: what moves the fingers of a Robotiq 2F-85 or 2F-140, and what they hold.

- `robotiq`: registers of the device. `driver`: the thread that commands it, and the conditions of docs/gripper.md.
- `fake`: the device in software.
"""

from poise.gripping.driver import DriverOptions, Fingers, GripperDriver, GripperReport
from poise.gripping.fake import FakeGripper
from poise.gripping.robotiq import GRIPPERS, GripperModel

__all__ = ["GRIPPERS", "DriverOptions", "FakeGripper", "Fingers", "GripperDriver", "GripperModel", "GripperReport"]

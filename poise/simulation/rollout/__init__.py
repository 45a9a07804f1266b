"""Free runs of a MuJoCo model from recorded states, under recorded commands or efforts, in windows.

- `recorded_run`: `RecordedRun`, what of a recording a free run needs.
- `free_arm`: a MuJoCo model of which the recorded joints alone move, and its inputs.
- `drive_fit`: gains and delays of drives from commands and motion.
- `drive_law`: the same where efforts were measured.
- `windows`: the windows of a recording, run together, and their errors.
"""

from poise.simulation.rollout.drive_fit import DRIVE_UNITS, DriveEstimate, DriveValue, fit_drives
from poise.simulation.rollout.drive_law import drives_by_effort
from poise.simulation.rollout.free_arm import FreeArm, InputKind
from poise.simulation.rollout.recorded_run import RecordedRun
from poise.simulation.rollout.windows import FreeRun, HorizonErrors, RolloutOptions, rolled_out, share_removed

__all__ = [
    "DRIVE_UNITS",
    "DriveEstimate",
    "DriveValue",
    "FreeArm",
    "FreeRun",
    "HorizonErrors",
    "InputKind",
    "RecordedRun",
    "RolloutOptions",
    "drives_by_effort",
    "fit_drives",
    "rolled_out",
    "share_removed",
]

"""The drives of a simulator's model against a recording with commands: gains, delays, and what is behind them."""

from collections.abc import Callable

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.mismatch.answer import Diagnosis
from poise.mismatch.application.free_run_input import recorded_run
from poise.mismatch.application.model_values import joint_values
from poise.mismatch.reading import ReadRecording
from poise.recording import Recording
from poise.simulation.rollout import DriveEstimate, FreeArm, fit_drives

_SHOWN_BY_EFFORTS = ("damping", "armature", "friction")


def found_drives(
    recording: Recording,
    reading: ReadRecording,
    found: Diagnosis | None,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[DriveEstimate, ...]:
    """The drives of a MuJoCo model, fitted to the motion under recorded commands; () where they cannot be.

    What joint efforts show (friction, rotors) is taken from the diagnosis; without efforts it is fitted too.

    Args:
        recording: with commands.
        reading: of it, against the model.
        found: the diagnosis; None: no signal could be examined.
        progress: is called with the completed share, 0 to 1.
    """
    simulator = reading.model.simulator
    if simulator is None or simulator.kind != "mjcf" or reading.recorded.commands is None:
        return ()
    if not any(drive.kind == "position" for drive in simulator.drives.values()):
        return ()
    try:
        arm = FreeArm(simulator.path, recorded_run(recording), "commands")
    except InputError as error:
        if error.code is ErrorCode.UNSUPPORTED:  # a joint without a drive or without commands
            return ()
        raise
    if found is None or reading.recorded.effort is None:
        return fit_drives(arm, progress=progress)
    known, now = joint_values(found), arm.drive_values()
    for name in _SHOWN_BY_EFFORTS:
        values = zip(arm.joints, now[name].tolist(), strict=True)
        now[name] = np.array([known.get(joint, {}).get(name, value) for joint, value in values])
    arm.set_drives(now)
    return fit_drives(arm, ("gain", "delay"), progress)

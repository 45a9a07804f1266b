"""The drives of a simulator's model against a recording with commands: gains, delays, and what is behind them."""

from collections.abc import Callable

from poise.errors import ErrorCode, InputError
from poise.mismatch.application.free_run_input import recorded_run
from poise.mismatch.reading import ReadRecording
from poise.recording import Recording
from poise.simulation.rollout import DriveEstimate, FreeArm, drives_by_effort, fit_drives


def found_drives(
    recording: Recording,
    reading: ReadRecording,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[DriveEstimate, ...]:
    """The drives of a MuJoCo model, fitted to the motion under recorded commands; () where they cannot be.

    Measured efforts show gains and delays directly, and the diagnosis has what is behind them. Without efforts, free
    runs are fitted, and friction and rotors with them.

    Args:
        recording: with commands.
        reading: of it, against the model.
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
    if reading.recorded.effort is None:
        return fit_drives(arm, progress=progress)
    return drives_by_effort(arm)

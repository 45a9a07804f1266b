"""Commands of a recording: on its clock, and how the joints followed them."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from poise.mismatch.reading.findings import InputFinding
from poise.mismatch.reading.joint_motion import seconds_since
from poise.mismatch.reading.joint_samples import averaged_joints
from poise.mismatch.recorded import CommandTrack
from poise.recording import JointStream, Recording, joint_commands
from poise.robot import each_stamp_once, stands_alone
from poise.types import Array

_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
_MOVES = 0.02
"""rad or m that a command must move for a delay to be seen."""
_LATEST = 0.5
"""s, longest delay that is looked for."""
_STEP = 0.002
"""s between the delays that are tried last; between them a parabola is laid."""
_COARSE = 4
"""Steps between the delays that are tried first: 8 ms, within which no command of a robot turns back."""
_BEYOND = 2 * 10**9
"""ns before and after the joint states within which commands are kept."""
_CLOCKS = 5e-3
"""s before its command from which on a motion shows that their clocks differ."""
_BLOCKS = 4
"""Parts of the recording whose delays give the scatter."""


def recorded_commands(recording: Recording) -> JointStream | None:
    """Commands of the topic `joint_commands`, or of the only topic with trajectories; None without them."""
    named = [name for name in recording.topics if name.strip("/").rpartition("/")[2] == "joint_commands"]
    trajectories = [name for name, kind in recording.topics.items() if kind == _TRAJECTORY]
    chosen = named or trajectories
    return joint_commands(recording, chosen[0]) if len(chosen) == 1 and recording.counts[chosen[0]] else None


def command_track(commands: JointStream, names: Sequence[str], start: int, end: int) -> CommandTrack | None:
    """The commands of these joints on the clock of the recording; None when they command none of them.

    Args:
        commands: as recorded.
        names: of the robot's joints.
        start, end: ns of the joint states; second zero is the start.
    """
    there = [name for name in names if name in commands.names]
    if not there or not len(commands):
        return None
    commands = averaged_joints(each_stamp_once(commands))[0]
    columns = [commands.names.index(name) for name in there]
    commands = commands.select(np.isfinite(commands.position[:, columns]).all(axis=1))
    rows = ~stands_alone(commands.position[:, columns], np.zeros(len(columns), dtype=bool))
    rows &= (commands.stamps > start - _BEYOND) & (commands.stamps < end + _BEYOND)
    seconds = seconds_since(commands.stamps[rows], start)
    if len(seconds) < 2:
        return None
    parts = (values[rows][:, columns] for values in (commands.position, commands.velocity))
    return CommandTrack(seconds, tuple(there), *parts)


def tracking(commands: CommandTrack, names: Sequence[str], seconds: Array, position: Array) -> InputFinding | None:
    """How late the joints follow their commands, and by how much they miss them; None when no command moves.

    Args:
        commands: of some of the joints.
        names: of the joints, (J).
        seconds: (N,) of the states.
        position: (N, J).
    """
    followed = []
    for column, name in enumerate(commands.names):
        track, moved = commands.position[:, column], position[:, list(names).index(name)]
        inside = (seconds >= commands.seconds[0] + _LATEST) & (seconds <= commands.seconds[-1])
        if np.ptp(track) > _MOVES and inside.sum() > 100:
            followed.append(_followed(name, commands.seconds, track, seconds[inside], moved[inside]))
    if not followed:
        return None
    said, joints, delays = zip(*followed, strict=True)
    return InputFinding("command_tracking", f"Joints behind their commands: {'; '.join(said)}.", joints, delays)


def _followed(name: str, sent_at: Array, sent: Array, at: Array, moved: Array) -> tuple[str, str, float]:
    """A sentence on one joint, its name, and its delay in s."""
    delay, gain, missed = _lag(sent_at, sent, at, moved)
    edges = np.linspace(0, len(at), _BLOCKS + 1).astype(int).tolist()
    parts = [_lag(sent_at, sent, at[a:b], moved[a:b])[0] for a, b in itertools.pairwise(edges)]
    scatter = max(float(np.std(parts, ddof=1) / np.sqrt(_BLOCKS)), 5e-4)
    if -max(_CLOCKS, 3.0 * scatter) < delay < 0.0:
        delay = 0.0
    late = (
        f"{1e3 * abs(delay):.1f} ± {1e3 * scatter:.1f} ms" if abs(delay) < _LATEST else f"over {1e3 * _LATEST:.0f} ms"
    )
    late += " late" if delay >= 0.0 else " before its command (their clocks differ)"
    off = float(np.sqrt(np.mean((moved - np.interp(at, sent_at, sent)) ** 2)))
    return f"{name} {late}, gain {gain:.3g}, off by {off:.2g} (rms, rad or m; then {missed:.2g})", name, delay


def _lag(sent_at: Array, sent: Array, at: Array, moved: Array) -> tuple[float, float, float]:
    """s by which a joint is late, its gain, and the rms error that delay, gain and an offset leave.

    A joint cannot move before its command, but its clock may say so.
    """

    def fitted(late: float) -> tuple[float, float]:
        command = np.interp(at - late, sent_at, sent)
        own, other = command - command.mean(), moved - moved.mean()
        gain = float(own @ other) / max(float(own @ own), 1e-300)
        return float(np.mean((other - gain * own) ** 2)), gain

    def best_of(steps: NDArray[np.int64]) -> tuple[int, Array]:
        square = np.array([fitted(late)[0] for late in (_STEP * steps).tolist()])
        return int(np.argmin(square)), square

    last = round(_LATEST / _STEP)
    coarse = np.arange(0, last + 1, _COARSE)
    best, square = best_of(coarse)
    if fitted(-_STEP)[0] < min(square.min(), fitted(_STEP)[0]):
        coarse = -coarse
        best, square = best_of(coarse)
    least, most = sorted((0, int(np.sign(coarse[-1])) * last))
    fine = np.arange(max(coarse[best] - _COARSE, least), min(coarse[best] + _COARSE, most) + 1)
    best, square = best_of(fine)
    delay = _STEP * float(fine[best])
    if 0 < best < len(fine) - 1:
        before, here, after = square[best - 1 : best + 2]
        delay += 0.5 * _STEP * float((before - after) / max(before - 2 * here + after, 1e-300))
    return delay, fitted(delay)[1], float(np.sqrt(square[best]))

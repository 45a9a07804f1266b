"""Stops of a transfer: within the limits of the joints, and gentle enough to keep what is held in the hand."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from poise.excitation.execution import Judge, ReadyStops, joint_judge
from poise.manipulation.arm import Arm
from poise.manipulation.execution import TransferStep
from poise.simulation import WaypointTrajectory
from poise.types import Array

_PERIOD = 0.01
"""s between the places of the tool that its speed and acceleration follow from."""
_TIMES = (0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 1.6)
"""s that a stop may take, tried from the shortest."""
_SAMPLES = 41


def with_stops(
    steps: Sequence[TransferStep],
    arm: Arm,
    held_point: Array,
    hold: float,
    cancelled: Callable[[], bool] = lambda: False,
) -> tuple[TransferStep, ...]:
    """The steps of a transfer with a stop for every instant of each motion.

    Args:
        steps: of the transfer.
        arm: that does it.
        held_point: (3,) m in the tool frame: centre of mass of the object in the hand.
        hold: m/s2 of that point that the grip withstands.
        cancelled: whether to give up.

    Raises:
        PoiseError: CANCELLED.
    """
    judge = joint_judge(arm.joint_names, arm.velocity_limit)
    out = []
    for step in steps:
        if step.motion is not None:
            own = _gentle(judge, arm, step.motion, held_point, hold) if step.holding else judge
            times = sorted({*_TIMES, step.stop_time}) if step.holding else _TIMES
            stops = ReadyStops.judged(step.motion, own, times, cancelled)
            step = step._replace(stops=stops)
        out.append(step)
    return tuple(out)


def _gentle(judge: Judge, arm: Arm, motion: WaypointTrajectory, held_point: Array, hold: float) -> Judge:
    """A judge that also bounds the acceleration of what is held.

    A stop is at `place(t)` of the motion: its acceleration is p'' place'^2 + p' place'', with p of the motion.
    """
    times = np.linspace(0.0, motion.duration, max(int(np.ceil(motion.duration / _PERIOD)), 3) + 1)
    way = CubicSpline(times, np.array([arm.tool(q).act(held_point) for q in motion.at(times).position]))
    u = np.linspace(0.0, 1.0, _SAMPLES)
    rate, change = (1 - 3 * u**2 + 2 * u**3)[:, None], (-6 * u + 6 * u**2)[:, None]

    def both(stop: WaypointTrajectory, begin: float) -> str:
        place = begin + stop.duration * (u - u**3 + u**4 / 2)
        inside = ((place >= 0.0) & (place <= motion.duration))[:, None]
        felt = np.where(inside, way(place, 2) * rate**2 + way(place, 1) * change / stop.duration, 0.0)
        hardest = float(np.linalg.norm(felt, axis=1).max())
        slips = f"{hardest:.3g} m/s2 of what is held, which slips above {hold:.3g}" if hardest > hold else ""
        return ", ".join(filter(None, (judge(stop, begin), slips)))

    return both

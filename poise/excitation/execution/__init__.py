"""A planned motion carried out: the arm is watched, and stopped along its path whenever something is wrong.

- `session`: `Session`, one identification from goal to answer. `joint_watch`: where the arm is, from joint states.
- `stops`: stops that are certified before the motion begins. `options`: times and tolerances.
"""

from poise.excitation.execution.joint_watch import Jointed, JointWatch
from poise.excitation.execution.options import ExecutionOptions
from poise.excitation.execution.session import (
    IdentificationTask,
    PayloadEstimatorPort,
    Plan,
    Session,
    SessionPhase,
    TimedMotion,
)
from poise.excitation.execution.stops import ReadyStops, Stop, brake, stop_along

__all__ = [
    "ExecutionOptions",
    "IdentificationTask",
    "JointWatch",
    "Jointed",
    "PayloadEstimatorPort",
    "Plan",
    "ReadyStops",
    "Session",
    "SessionPhase",
    "Stop",
    "TimedMotion",
    "brake",
    "stop_along",
]

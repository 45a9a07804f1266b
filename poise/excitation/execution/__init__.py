"""Execution of a planned motion: the arm is supervised, and stopped along its path after a fault.

- `session`: `Session`, one identification from goal to answer. `joint_watch`: the state of the arm from joint states.
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

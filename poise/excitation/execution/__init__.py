"""Execution of a planned motion: the arm is supervised, and stopped along its path after a fault.

- `session`: `Session`, one identification from goal to answer. `joint_watch`: the state of the arm from joint states.
- `stops`: stops that are certified before the motion begins. `commanded`: motions are sent with their stops ready.
- `held_up`: streams are trusted after the process was delayed. `options`: times and tolerances.
"""

from poise.excitation.execution.commanded import NOT_WATCHED, CommandedArm, SentStop, TimedMotion, Watchdog
from poise.excitation.execution.held_up import HeldUp
from poise.excitation.execution.joint_watch import Jointed, JointWatch
from poise.excitation.execution.options import DEFAULT_EXECUTION, ExecutionOptions
from poise.excitation.execution.session import (
    IdentificationTask,
    PayloadEstimatorPort,
    Plan,
    Session,
    SessionPhase,
)
from poise.excitation.execution.stops import Judge, ReadyStops, Stop, brake, joint_judge

__all__ = [
    "DEFAULT_EXECUTION",
    "NOT_WATCHED",
    "CommandedArm",
    "ExecutionOptions",
    "HeldUp",
    "IdentificationTask",
    "JointWatch",
    "Jointed",
    "Judge",
    "PayloadEstimatorPort",
    "Plan",
    "ReadyStops",
    "SentStop",
    "Session",
    "SessionPhase",
    "Stop",
    "TimedMotion",
    "Watchdog",
    "brake",
    "joint_judge",
]

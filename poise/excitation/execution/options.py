"""Times and tolerances of a motion that is carried out."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ExecutionOptions:
    """When to wait, when to give up, and how far an arm may be off.

    Args:
        patience: s to wait for joint states, wrenches, and an arm at rest.
        stale: s without joint states or wrenches after which the arm is stopped.
        held_up: s between two ticks that show that the process was delayed, with unread messages of live streams.
        planning: s that planning may take; the search has a shorter limit.
        lead: s between sending a motion and its begin; it must have arrived by then.
        stop_lead: s between sending a stop and its begin.
        settle: s of rest after the motion that still belong to it.
        moved: rad or m from the planned start; beyond it another program has moved the arm.
        off_path: rad or m that an arm may be off its path, besides `lag`.
        lag: s of the joint's speed that an arm may be behind.
        stopping: s that an arm may take to come to rest.
        holding: s of a command to stay in place.
        arming: s that a watchdog may take to watch a motion; it is asked again until then.
        answer: s that a watchdog may take to send a stop that it was asked for; then the program sends it itself.
    """

    patience: float = 2.0
    stale: float = 0.5
    held_up: float = 0.1
    planning: float = 40.0
    lead: float = 0.15
    stop_lead: float = 0.06
    settle: float = 0.15
    moved: float = 0.01
    off_path: float = 0.03
    lag: float = 0.15
    stopping: float = 3.0
    holding: float = 0.4
    arming: float = 0.5
    answer: float = 0.05


DEFAULT_EXECUTION = ExecutionOptions()

"""What a recording itself shows to be wrong or missing, before any effect is looked for."""

from dataclasses import dataclass


@dataclass(frozen=True)
class InputFinding:
    """One finding about the input.

    Args:
        kind: in snake_case: effort_zero, effort_constant, effort_unsigned, effort_sign, effort_unit, effort_unrelated,
            effort_order, effort_late, effort_compensated, effort_frozen, effort_limited, no_effort, no_motion,
            joints_at_rest, joints_held, joints_mixed, encoder_frozen, command_tracking, limit_exceeded, wrench_frozen.
        sentence: what it is, with its consequence.
        joints: that it concerns.
        values: numbers behind it, by joint: the factor of a unit, or the delay in s behind the commands; begin and end
            of a span in s.
    """

    kind: str
    sentence: str
    joints: tuple[str, ...] = ()
    values: tuple[float, ...] = ()

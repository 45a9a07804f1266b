"""What a recording itself shows to be wrong or missing, before any effect is looked for."""

from dataclasses import dataclass

import numpy as np

from poise.types import Array


@dataclass(frozen=True)
class InputFinding:
    """One finding about the input.

    Args:
        kind: in snake_case: effort_zero, effort_constant, effort_unsigned, effort_sign, effort_unit, effort_unrelated,
            effort_order, effort_late, effort_compensated, effort_frozen, effort_limited, no_effort, no_motion,
            base_turned, joints_at_rest, joints_held, joints_mixed, encoder_frozen, command_tracking, limit_exceeded,
            noise_stated, wrench_frozen.
        sentence: what it is, with its consequence.
        joints: that it concerns.
        values: numbers behind it, by joint: the factor of a unit, or the delay in s behind the commands; begin and end
            of a span in s.
    """

    kind: str
    sentence: str
    joints: tuple[str, ...] = ()
    values: tuple[float, ...] = ()


def turned_base(direction: Array) -> tuple[float, str]:
    """By how many degrees a base is turned in which loads hang along a direction (3,), and that in words."""
    x, y, z = direction / max(float(np.linalg.norm(direction)), 1e-9)
    angle = float(np.degrees(np.arccos(np.clip(-z, -1.0, 1.0))))
    return angle, (
        f"along {x:.2f} {y:.2f} {z:.2f} in the axes of the base, not along 0 0 -1: the base is turned by {angle:.0f} "
        "degrees; describe its mounting with a fixed joint from a level link to the base"
    )

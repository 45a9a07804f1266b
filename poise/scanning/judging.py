"""What is said of the surface that no view saw, and when it is too much."""

from poise.errors import ErrorCode, InputError
from poise.scanning.completion import Completed

_UNKNOWN_ERROR, _UNKNOWN_NOTE, _UNKNOWN_LEAST = 0.15, 0.04, 1.5e-4
"""Shares of the footprint, and m2, of which nothing is known."""
_DOUBTFUL = 0.1
"""Share of the volume that completed surface may be off by, two sigmas, above which the cause is said."""
_SIDES_ERROR, _SIDES_NOTE = 0.35, 0.12
"""Shares of the surface, without its underside, that no view saw."""


def judge(hidden: Completed) -> list[str]:
    """Sentences about what was not seen.

    Raises:
        InputError: SCAN_INCOMPLETE when that is too much.
    """
    unknown = hidden.unknown / hidden.footprint
    if hidden.unknown > _UNKNOWN_LEAST and unknown > _UNKNOWN_ERROR:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"scan: of {1e4 * hidden.unknown:.1f} cm2 in and beside the object ({unknown:.0%} of its footprint) no view"
            " gives any depth: it is glass, shiny or black (powder it, or cover it with tape), or lies in a shadow"
            " (look from the other sides too)",
            unknown=hidden.unknown,
        )
    notes = []
    if hidden.unknown > _UNKNOWN_LEAST and unknown > _UNKNOWN_NOTE:
        notes.append(f"{1e4 * hidden.unknown:.1f} cm2 in and beside the object gave no depth in any view")
    if hidden.hidden_sides > _SIDES_ERROR:
        raise InputError(
            ErrorCode.SCAN_INCOMPLETE,
            f"scan: {hidden.hidden_sides:.0%} of the object's sides were not seen; sweep the camera all around it, and"
            " lower",
            sides=hidden.hidden_sides,
        )
    notes.append(f"{hidden.hidden:.0%} of the surface was not seen and completed down to the table")
    if hidden.hidden_sides > _SIDES_NOTE:
        notes.append(f"{hidden.hidden_sides:.0%} of its sides are guessed: sweep the camera all around it, and lower")
    share = 2 * hidden.doubtful / hidden.volume
    if share > _DOUBTFUL:
        notes.append(
            f"about {share:.0%} of the volume may be air under the object, or a hollow that no view looks into, and"
            " counts as object: turn it over, or stand it up, and scan again"
        )
    return notes

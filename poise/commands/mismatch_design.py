"""The designed motion of `poise mismatch --separate`: searched, written as a trajectory, and reported."""

from pathlib import Path
from typing import Any

import numpy as np

from poise.commands.output import progress_bar
from poise.mismatch.answer import Diagnosis, DiscriminatingMotion, design_motion
from poise.robot import RobotModel

_STEP = 0.1
"""s between the waypoints of a written motion; between them it is a quintic."""


def designed(found: Diagnosis, robot: RobotModel | None) -> DiscriminatingMotion | None:
    """The motion for the first signal with an ambiguous answer; None without one, or without joint states."""
    if robot is None:
        return None
    with progress_bar("designing a motion") as progress:
        for examined in found.examinations:
            design = design_motion(examined, robot, progress=progress)
            if design is not None:
                return design
    return None


def write_design(path: Path, design: DiscriminatingMotion) -> Path:
    """Write the motion for `poise simulate` and `fake_robot`.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    from poise.excitation import write_waypoints  # loads slowly

    times = np.linspace(0.0, design.trajectory.duration, round(design.trajectory.duration / _STEP) + 1)
    return write_waypoints(
        path, design.joint_names, times, design.trajectory.at(times), f"{design_sentence(design)} (poise mismatch)"
    )


def design_sentence(design: DiscriminatingMotion | None) -> str:
    """The purpose of the motion, and its expected evidence."""
    if design is None:
        return "The answer has no ambiguity that a motion of the joints could resolve."
    first, *rivals = design.names
    purpose = f"{design.trajectory.duration:.0f} s of joint motion distinguish {first} from {', '.join(rivals)}"
    speed = float(np.abs(design.trajectory.at(np.linspace(0, design.trajectory.duration, 1401)).velocity).max())
    outlook = f"(expected log evidence {design.expected:.0f}; at most {speed:.2f} rad/s; not checked for collisions)."
    return (
        f"{purpose} {outlook}"
        if design.enough
        else f"The best motion found distinguishes {first} from {', '.join(rivals)} only weakly {outlook}"
    )


def design_json(design: DiscriminatingMotion | None, path: Path | None) -> dict[str, Any] | None:
    """For the answer; None when there is no motion."""
    if design is None:
        return None
    return {
        "between": list(design.names),
        "file": None if path is None else str(path),
        "duration": design.trajectory.duration,
        "expected_log_evidence": design.expected,
        "enough": design.enough,
    }

"""The designed motion of `poise mismatch --separate`: found, written as a trajectory, and told."""

from pathlib import Path
from typing import Any

import numpy as np

from poise.commands.output import progress_bar
from poise.excitation.plan_file import write_waypoints
from poise.mismatch.answer import Diagnosis, DiscriminatingMotion, separating_motion
from poise.robot import RobotModel

_STEP = 0.1
"""s between the waypoints of a written motion; between them it is a quintic."""


def designed(found: Diagnosis, robot: RobotModel | None) -> DiscriminatingMotion | None:
    """The motion for the first signal that leaves something open; None without one, or without joint states."""
    if robot is None:
        return None
    with progress_bar("designing a motion") as progress:
        for examined in found.examinations:
            design = separating_motion(examined, robot, progress=progress)
            if design is not None:
                return design
    return None


def write_design(path: Path, design: DiscriminatingMotion) -> Path:
    """Write the motion for `poise simulate` and `fake_robot`.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    times = np.linspace(0.0, design.trajectory.duration, round(design.trajectory.duration / _STEP) + 1)
    return write_waypoints(
        path, design.joint_names, times, design.trajectory.at(times), f"{design_sentence(design)} (poise mismatch)"
    )


def design_sentence(design: DiscriminatingMotion | None) -> str:
    """What it is for, and how far it will go."""
    if design is None:
        return "Nothing that a motion of the joints could tell apart is open."
    first, *rivals = design.names
    said = f"{design.trajectory.duration:.0f} s of joint motion tell {first} from {', '.join(rivals)}"
    speed = float(np.abs(design.trajectory.at(np.linspace(0, design.trajectory.duration, 1401)).velocity).max())
    told = f"(expected log evidence {design.expected:.0f}; at most {speed:.2f} rad/s; not checked for collisions)."
    return (
        f"{said} {told}"
        if design.enough
        else f"The best motion found tells {first} from {', '.join(rivals)} only weakly {told}"
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

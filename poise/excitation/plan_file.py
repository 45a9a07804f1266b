"""A planned motion as a trajectory file, which `fake_robot` and `poise simulate` play."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from poise.excitation.plan import ExcitationPlan
from poise.files import write_whole
from poise.simulation import JointMotion
from poise.types import Array

_DIGITS = 9


def write_plan(path: Path, plan: ExcitationPlan, remark: str = "") -> Path:
    """Write waypoints with velocities and accelerations, see `poise.simulation.read_trajectory`.

    Args:
        path: .yaml
        plan: the motion.
        remark: one line for the head of the file.

    Raises:
        InputError: FILE_UNWRITABLE.
    """
    motion = plan.motion
    moved = JointMotion(motion.position, np.asarray(motion.velocity), np.asarray(motion.acceleration))
    return write_waypoints(path, plan.joint_names, motion.times, moved, remark)


def write_waypoints(
    path: Path, joint_names: Sequence[str], times: Array, motion: JointMotion, remark: str = ""
) -> Path:
    """The same of any motion.

    Args:
        path: .yaml
        joint_names: (J).
        times: (K,) s.
        motion: (K, J) at these times.
        remark: one line for the head of the file.

    Raises:
        InputError: FILE_UNWRITABLE.
    """

    def row(values: Array) -> list[float]:
        return [float(value) for value in np.round(values, _DIGITS) + 0.0]

    columns = zip(times, *motion, strict=True)
    waypoints = [
        {"time": round(float(t), _DIGITS), "position": row(q), "velocity": row(v), "acceleration": row(a)}
        for t, q, v, a in columns
    ]
    content: dict[str, Any] = {"joints": list(joint_names), "waypoints": waypoints}
    head = f"# {' '.join(remark.split())}\n" if remark else ""
    return write_whole(
        path, (head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=200)).encode()
    )

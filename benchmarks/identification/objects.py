"""The objects that the benchmarks weigh, as the sensor holds them: workshop tools with known parameters and parts."""

import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poise.errors import ErrorCode, InputError
from poise.inertia.model.parameters import InertialParameters, frame_change
from poise.robot import SensorMotion
from poise.types import Array

SHIPPED = Path(__file__).resolve().parents[1] / "data" / "workshop_tools.npz"
ENVIRONMENT = "POISE_TOOLS"


@dataclass(frozen=True, eq=False)
class BenchmarkObject:
    """An object fixed to a sensor; everything in the sensor frame, metres and kilograms.

    Args:
        name: of the object.
        truth: its inertial parameters.
        bounding_box: (3,) side lengths along the sensor's axes.
        hull: (H, 3) corners of its convex hull.
        unit_parts: (10, K) phi of each part at 1 kg, as if homogeneous.
        part_volumes: (K,) m3.
        points: (P, 3) spread at random inside it, evenly over its volume.
        stop_and_go: the motion that identifies it without danger (thesis fig. 3.11), if there is one.
    """

    name: str
    truth: InertialParameters
    bounding_box: Array
    hull: Array
    unit_parts: Array
    part_volumes: Array
    points: Array
    stop_and_go: SensorMotion | None = None

    @property
    def volume(self) -> float:
        """m3."""
        return float(self.part_volumes.sum())


@functools.cache
def load_tools(source: Path | None = None) -> tuple[BenchmarkObject, ...]:
    """The workshop tools (thesis section 3.2.4) in the order of their names.

    Args:
        source: an .npz of `tools/convert_workshop_tools.py`, or the dataset's own folder (converted on the fly).
            By default what the environment variable POISE_TOOLS names, or else the 14 tools that come along.

    Raises:
        InputError: FILE_UNREADABLE.
    """
    path = source or Path(os.environ.get(ENVIRONMENT, SHIPPED))
    if path.is_dir():
        from tools.convert_workshop_tools import convert_all

        arrays = convert_all(path)
    else:
        try:
            with np.load(path, allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
        except (OSError, ValueError) as error:
            raise InputError(
                ErrorCode.FILE_UNREADABLE,
                f"{path}: no workshop tools there ({error}); give what tools/convert_workshop_tools.py writes",
            ) from error
    tools: dict[str, dict[str, NDArray[Any]]] = {}
    for key, value in arrays.items():
        name, array = key.split("/")
        tools.setdefault(name, {})[array] = value
    return tuple(_tool(name, tools[name]) for name in sorted(tools))


def _tool(name: str, arrays: dict[str, NDArray[Any]]) -> BenchmarkObject:
    rotation, translation = arrays["pose_in_sensor"][:3, :3], arrays["pose_in_sensor"][:3, 3]
    into_sensor = frame_change(rotation, translation)
    hull = arrays["hull"] @ rotation.T + translation
    return BenchmarkObject(
        name=name,
        truth=InertialParameters.from_phi(into_sensor @ arrays["phi"]),
        bounding_box=np.ptp(hull, axis=0),
        hull=hull,
        unit_parts=into_sensor @ arrays["unit_parts"],
        part_volumes=arrays["volumes"],
        points=arrays["points"].astype(np.float64) @ rotation.T + translation,
        stop_and_go=SensorMotion(
            stamps=np.round(arrays["time"].astype(np.float64) * 1e3).astype(np.int64) * 1_000_000,
            rotation_world_sensor=Rotation.from_quat(arrays["quaternion_world_sensor"].astype(np.float64)).as_matrix(),
            angular_velocity_in_sensor=arrays["angular_velocity"],
            angular_acceleration_in_sensor=arrays["angular_acceleration"],
            linear_acceleration_in_sensor=arrays["linear_acceleration"],
        ),
    )

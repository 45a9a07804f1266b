"""A model file of a simulator: its kind by its root element, and its content."""

import re
from pathlib import Path
from xml.etree import ElementTree

from poise.errors import ErrorCode, InputError
from poise.robot import find_urdf, parse_urdf, read_urdf
from poise.simulation.models.description import JointPhysics, ModelKind, SimulatorModel
from poise.simulation.models.mjcf import read_mjcf
from poise.simulation.models.sdf import read_sdf

_KINDS: dict[str, ModelKind] = {"mujoco": "mjcf", "sdf": "sdf", "robot": "urdf"}
_HEAD = 100_000
"""Bytes in which the root element must begin."""


def model_kind(path: Path) -> ModelKind | None:
    """The kind of a model file by its root element; None for another file.

    Raises:
        InputError: FILE_UNREADABLE.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"cannot read the model {path}: {error.strerror}") from error
    text = re.sub(r"<\?.*?\?>|<!--.*?(-->|$)", "", head.decode("utf-8", "replace"), flags=re.DOTALL)
    root = re.match(r"\s*\ufeff?\s*<([A-Za-z_]+)", text)
    return _KINDS.get(root[1]) if root else None


def read_simulator_model(path: Path) -> SimulatorModel:
    """A MJCF, SDF or URDF file.

    Raises:
        InputError: FILE_UNREADABLE; BAD_INPUT for another kind of file; as `read_mjcf` and `read_sdf`.
    """
    kind = model_kind(path)
    if kind == "mjcf":
        return read_mjcf(path)
    if kind == "sdf":
        return read_sdf(path)
    if kind == "urdf":
        text = read_urdf(find_urdf(path))
        return SimulatorModel(path, "urdf", text, joints=urdf_physics(text))
    raise InputError(
        ErrorCode.BAD_INPUT, f"{path}: no model; give MJCF (<mujoco>), SDF (<sdf>) or a URDF (<robot>) as XML"
    )


def urdf_physics(text: str) -> dict[str, JointPhysics]:
    """The friction and damping that `dynamics` state, of the joints that have any.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID.
    """
    if "<dynamics" not in text:
        return {}
    parse_urdf(text)  # checks the names and numbers that are read below
    found: dict[str, JointPhysics] = {}
    for joint in ElementTree.fromstring(text.strip()).iter("joint"):
        stated = joint.find("dynamics")
        if stated is not None:
            physics = JointPhysics(*(float(stated.get(name, 0.0)) for name in ("friction", "damping")))
            found |= {joint.get("name", ""): physics} if physics.values else {}
    return found

"""model.yaml: the nominal model that a recording is compared with, and its tolerances."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from poise.errors import ErrorCode, InputError
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.model import InertialParameters, symmetric
from poise.ranges import check_range
from poise.simulation.models import SimulatorModel, model_kind, read_simulator_model
from poise.types import Array

_MAX_BYTES = 1_000_000
_YAML = (".yaml", ".yml", ".json")
_ENTRIES = (
    *(
        "sensor_frame",
        "urdf",
        "simulator",
        "payload",
        "payload_link",
        "gravity",
        "tool_in_wrench",
        "joint_positions",
        "tolerance",
        "noise",
    ),
    "effects",
)


@dataclass(frozen=True)
class Tolerance:
    """Declared tolerances: an error anywhere between plus and minus its tolerance is no finding.

    Args:
        payload_mass: relative. payload_com: m. payload_inertia: relative, of the trace.
        bias_force, bias_torque: N, N m, each axis. drift_force, drift_torque: N, N m, over the recording.
        sensor_gain: relative, each entry of the 6x6 matrix; from force to torque times 0.1 m, and back over 0.1 m.
        sensor_rotation, base_tilt: rad, each axis. joint_offset: rad or m. clock_offset: s.
        link_mass: relative, of each link with its moments. motor_gain: relative. effort_offset: of the joint's largest
            effort in the recording.
    """

    payload_mass: float = 0.01
    payload_com: float = 0.002
    payload_inertia: float = 0.1
    bias_force: float = 0.4
    bias_torque: float = 0.025
    drift_force: float = 0.12
    drift_torque: float = 0.008
    sensor_gain: float = 0.01
    sensor_rotation: float = 0.004
    joint_offset: float = 0.001
    clock_offset: float = 0.004
    base_tilt: float = 0.002
    link_mass: float = 0.01
    motor_gain: float = 0.01
    effort_offset: float = 0.01


_LARGEST = 5.0
"""m: no payload reaches farther from the sensor; larger numbers are of another unit."""
# The keys of each tolerance in the file.
TOLERANCE_KEYS = {
    "payload_mass": ("payload", "mass"),
    "payload_com": ("payload", "com"),
    "payload_inertia": ("payload", "inertia"),
    "bias_force": ("sensor_bias", "force"),
    "bias_torque": ("sensor_bias", "torque"),
    "drift_force": ("bias_drift", "force"),
    "drift_torque": ("bias_drift", "torque"),
    "sensor_gain": ("sensor_gain",),
    "sensor_rotation": ("sensor_rotation",),
    "joint_offset": ("joint_offset",),
    "clock_offset": ("clock_offset",),
    "base_tilt": ("base_tilt",),
    "link_mass": ("link_mass",),
    "motor_gain": ("motor_gain",),
    "effort_offset": ("effort_offset",),
}


@dataclass(frozen=True, eq=False)
class ModelEffect:
    """An effect that is part of a model: its values, and their covariance in the order of `values`."""

    name: str
    values: dict[str, float]
    covariance: Array


@dataclass(frozen=True, eq=False)
class NominalModel:
    """The nominal model.

    Args:
        sensor_frame: None: the frame of the wrench messages.
        urdf: None: the recording's robot_description.
        phi: (10,) payload about the sensor's origin, sensor axes; None: identified from the recording.
        gravity: m/s2; None: from the recording's metadata, else the standard.
        tool_in_wrench: the wrench also carries what the URDF fixes beyond the sensor (a gripper that was not zeroed).
        noise_force, noise_torque: N and N m of one sample; None: estimated.
        effects: added by an earlier diagnosis.
        joint_positions: joints that have no states, and where they stand, rad or m.
        payload_identified: the payload was identified from the recording, which then cannot show it wrong.
        simulator: the model of a simulator, in the place of the URDF.
        payload_link: the link of it that is the payload alone.
    """

    sensor_frame: str | None = None
    urdf: Path | None = None
    phi: Array | None = None
    gravity: float | None = None
    tool_in_wrench: bool = False
    tolerance: Tolerance = field(default_factory=Tolerance)
    noise_force: float | None = None
    noise_torque: float | None = None
    effects: tuple[ModelEffect, ...] = ()
    joint_positions: Mapping[str, float] = field(default_factory=dict)
    payload_identified: bool = False
    simulator: SimulatorModel | None = None
    payload_link: str | None = None

    def effect(self, name: str) -> ModelEffect | None:
        """The effect of this name in the model; None where it has none."""
        return next((each for each in self.effects if each.name == name), None)

    @property
    def gravity_or_standard(self) -> float:
        """m/s2, downwards."""
        return STANDARD_GRAVITY if self.gravity is None else self.gravity


def load_model(path: Path) -> NominalModel:
    """Read model.yaml, or the model of a simulator (MJCF, SDF) or a URDF in its place.

    Raises:
        InputError: FILE_UNREADABLE; BAD_INPUT for an invalid entry, with its place; as `read_simulator_model`.
    """
    kind = None if path.suffix in _YAML else model_kind(path)
    if kind == "urdf":
        return NominalModel(urdf=path)
    if kind is not None:
        return simulated_by(NominalModel(), read_simulator_model(path))
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(ErrorCode.BAD_INPUT, f"{path}: larger than {_MAX_BYTES} bytes, not a model")
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"cannot read the model {path}: {error.strerror}") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(ErrorCode.BAD_INPUT, f"{path}: not YAML ({' '.join(str(error).split())})") from error
    try:
        return parse_model({} if content is None else content, path.parent)
    except InputError as error:
        raise InputError(error.code, f"{path}: {error.message}", **error.data) from error


def simulated_by(model: NominalModel, simulator: SimulatorModel, tool: bool | None = None) -> NominalModel:
    """The model with a simulator's robot and gravity; its force sensor feels all that is beyond it, unless said."""
    felt = bool(simulator.sensors) if tool is None else tool
    gravity = simulator.gravity if model.gravity is None else model.gravity
    return replace(model, simulator=simulator, gravity=gravity, tool_in_wrench=felt)


def parse_model(content: Any, folder: Path = Path()) -> NominalModel:
    """A model from the content of its file; paths in it start at `folder`.

    Raises:
        InputError: BAD_INPUT.
    """
    top = _mapping(content, "the model", _ENTRIES)
    held = top.get("joint_positions", {})
    noise = _mapping(top.get("noise", {}), "noise", ("force", "torque"))
    urdf, simulator = _text(top, "urdf"), _text(top, "simulator")
    if urdf is not None and simulator is not None:
        raise _bad("urdf and simulator are both given: which is the robot?")
    tool = top.get("tool_in_wrench", False)
    if not isinstance(tool, bool):
        raise _bad("tool_in_wrench must be true or false")
    if not isinstance(held, Mapping):
        raise _bad("joint_positions must be a mapping of joints to rad or m")
    model = NominalModel(
        joint_positions={str(name): _number(at, f"joint_positions.{name}") for name, at in held.items()},
        sensor_frame=_text(top, "sensor_frame"),
        urdf=None if urdf is None else folder / urdf if (folder / urdf).is_file() else Path(urdf),
        phi=_payload(top["payload"]) if top.get("payload") is not None else None,
        gravity=_gravity(top["gravity"]) if "gravity" in top else None,
        tool_in_wrench=tool,
        tolerance=_tolerance(top.get("tolerance", {})),
        noise_force=_positive(noise["force"], "noise.force") if "force" in noise else None,
        noise_torque=_positive(noise["torque"], "noise.torque") if "torque" in noise else None,
        effects=tuple(_component(entry, i) for i, entry in enumerate(_list(top.get("effects", []), "effects"))),
        payload_link=_text(top, "payload_link"),
    )
    if simulator is None:
        return model
    return simulated_by(model, read_simulator_model(folder / simulator), top.get("tool_in_wrench"))


def dump_model(model: NominalModel) -> str:
    """The text of model.yaml; `parse_model` of it gives an equal model."""
    content: dict[str, Any] = {}
    if model.sensor_frame is not None:
        content["sensor_frame"] = model.sensor_frame
    if model.urdf is not None:
        content["urdf"] = str(model.urdf)
    if model.simulator is not None:
        content["simulator"] = str(model.simulator.path)
    if model.payload_link is not None:
        content["payload_link"] = model.payload_link
    if model.phi is not None and model.payload_link is None:
        body = InertialParameters.from_phi(model.phi)
        com = [0.0, 0.0, 0.0] if body.mass == 0 else body.com.tolist()
        content["payload"] = {"mass": body.mass, "com": com}
        # An inertia that was identified from a motion that does not show it may be of no body.
        if body.mass and _is_inertia(body.inertia):
            content["payload"]["inertia"] = body.inertia_vector.tolist()
    if model.gravity is not None and model.gravity != STANDARD_GRAVITY:
        content["gravity"] = model.gravity
    if model.tool_in_wrench:
        content["tool_in_wrench"] = True
    if model.joint_positions:
        content["joint_positions"] = dict(model.joint_positions)
    tolerance: dict[str, Any] = {}
    for name, keys in TOLERANCE_KEYS.items():
        place = tolerance if len(keys) == 1 else tolerance.setdefault(keys[0], {})
        place[keys[-1]] = getattr(model.tolerance, name)
    content["tolerance"] = tolerance
    noise = {"force": model.noise_force, "torque": model.noise_torque}
    if any(noise.values()):
        content["noise"] = {key: value for key, value in noise.items() if value is not None}
    if model.effects:
        content["effects"] = [
            {"name": part.name, "parameters": dict(part.values), "covariance": part.covariance.tolist()}
            for part in model.effects
        ]
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True)


def _payload(value: Any) -> Array:
    payload = _mapping(value, "payload", ("mass", "com", "inertia"))
    mass = _number(payload.get("mass"), "payload.mass")
    com = _numbers(payload.get("com", [0.0, 0.0, 0.0]), 3, "payload.com")
    inertia = symmetric(_numbers(payload.get("inertia", [0.0] * 6), 6, "payload.inertia"))
    if mass < 0:
        raise _bad(f"payload.mass is {mass:g} kg: it must not be negative; 0 is no payload")
    if not _is_inertia(inertia):
        raise _bad(
            "no body has payload.inertia: ixx ixy ixz iyy iyz izz about the centre of mass need a positive sum of any "
            "two principal moments over the third; leave it out when it is not known"
        )
    far, spread = float(np.linalg.norm(com)), float(np.sqrt(0.5 * np.trace(inertia) / mass)) if mass else 0.0
    if far > _LARGEST:
        raise _bad(f"payload.com is {far:.3g} m from the sensor: give it in m")
    if spread > _LARGEST:
        raise _bad(f"payload.inertia is that of {mass:g} kg spread over {spread:.3g} m: give it in kg m2")
    return InertialParameters(mass, com, inertia).phi


def _is_inertia(inertia: Array) -> bool:
    """(3, 3) about the centre of mass: no negative moment, and none above the sum of the others."""
    low, middle, high = np.linalg.eigvalsh(inertia).tolist()
    return bool(low >= -1e-9 and low + middle >= high * (1 - 1e-6) - 1e-12)


def _tolerance(value: Any) -> Tolerance:
    groups = {keys[0] for keys in TOLERANCE_KEYS.values()}
    given = _mapping(value, "tolerance", sorted(groups))
    found: dict[str, float] = {}
    for group in groups & given.keys():
        members = {keys[-1]: name for name, keys in TOLERANCE_KEYS.items() if keys[0] == group and len(keys) == 2}
        if members:
            entries = _mapping(given[group], f"tolerance.{group}", sorted(members))
            found |= {members[key]: _positive(entry, f"tolerance.{group}.{key}") for key, entry in entries.items()}
        else:
            found[group] = _positive(given[group], f"tolerance.{group}")
    return Tolerance(**found)


def _component(value: Any, index: int) -> ModelEffect:
    entry = _mapping(value, f"effects[{index}]", ("name", "parameters", "covariance"))
    name = _text(entry, "name")
    if name is None:
        raise _bad(f"effects[{index}] has no name")
    parameters = entry.get("parameters")
    if not isinstance(parameters, Mapping):
        raise _bad(f"effects[{index}].parameters must be a mapping")
    values = {str(key): _number(number, f"effects[{index}].{key}") for key, number in parameters.items()}
    size = len(values)
    rows = _list(entry.get("covariance", [[0.0] * size] * size), f"effects[{index}].covariance")
    matrix = [_numbers(row, size, f"effects[{index}].covariance") for row in rows]
    if len(matrix) != size:
        raise _bad(f"effects[{index}].covariance must have {size} rows")
    return ModelEffect(name, values, np.array(matrix).reshape(size, size))


def _mapping(value: Any, what: str, known: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise _bad(f"{what} must be a mapping")
    unknown = [str(key) for key in value if key not in known]
    if unknown:
        raise _bad(f"{what} knows {', '.join(known)}; not {', '.join(unknown)}")
    return value


def _list(value: Any, what: str) -> list[Any]:
    if not isinstance(value, list):
        raise _bad(f"{what} must be a list")
    return value


def _text(content: Mapping[str, Any], key: str) -> str | None:
    value = content.get(key)
    if value is not None and not (isinstance(value, str) and value):
        raise _bad(f"{key} must be a text")
    return value


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise _bad(f"{what} must be a number, got {value!r}")
    return float(value)


def _positive(value: Any, what: str) -> float:
    number = _number(value, what)
    if number <= 0:
        raise _bad(f"{what} must be positive, got {number:g}")
    return number


def _gravity(value: Any) -> float:
    gravity = _number(value, "gravity")
    check_range("gravity of a recording", gravity)
    return gravity


def _numbers(value: Any, count: int, what: str) -> Array:
    if not isinstance(value, list) or len(value) != count:
        raise _bad(f"{what} must be {count} numbers")
    return np.array([_number(item, what) for item in value])


def _bad(reason: str) -> InputError:
    return InputError(ErrorCode.BAD_INPUT, reason)

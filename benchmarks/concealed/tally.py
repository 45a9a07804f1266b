"""The score of one answer: was the right thing named, located and measured?"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

SENSOR_EFFECTS = (
    *("sensor_bias", "bias_drift", "sensor_creep", "sensor_gain", "sensor_nonlinearity", "sensor_rotation"),
    *("quantisation", "saturation", "low_pass", "clock_offset", "clock_skew", "base_tilt", "joint_offset"),
    "payload_parameters",
)
MOVING_PARTS = ("slosh", "hanging_chain", "loose_part", "grasp_compliance", "flexible_mode", "flywheel")

# What is measured of an effect where not all of its parameters say how large it is; stems of vectors.
MAIN_PARAMETERS: dict[str, tuple[str, ...]] = {
    "mass_step": ("mass",),
    "mass_leak": ("rate",),
    "world_force": ("force",),
    "cable": ("stiffness",),
    "air_drag": ("coefficient",),
    "slosh": ("mass", "length"),
    "hanging_chain": ("mass", "length"),
    "loose_part": ("mass", "gap"),
    "flexible_mode": ("mass", "frequency"),
    "grasp_compliance": ("stiffness",),
    "contact": ("peak_force",),
    "external_vibration": ("amplitude", "frequency"),
    "payload_parameters": ("mass", "com"),
    "stribeck_friction": ("torque", "stiction", "damping"),
    "gear_ripple": ("amplitude", "order"),
    "backlash": ("gap",),
    "joint_coupling": ("inertia", "damping"),
}
AXIS = re.compile(r"_(?:[xyz]|[1-9]|[ft][xyz]|[ft][xyz]_[ft][xyz])$")
SMALLEST = 1e-12

STATES = {
    "gravity_direction": r"gravity|attitude|orientation",
    "base_acceleration": r"base.*accel",
    "joint_acceleration": r"accel",
    "joint_velocity": r"speed|velocit",
    "joint_position": r"position|angle",
    "load": r"load",
    "time": r"time|elapsed",
}
"""How each state may be spelt; the first that fits counts."""


@dataclass(frozen=True)
class Verdict:
    """One case judged.

    Args:
        case, kind: of the label.
        truth: names of its effects.
        strength: 0.3 or 1.
        answered: there was an answer.
        verdict: none, named, unknown or mixed; "" without an answer.
        named: names in the answer, the likeliest first.
        first: the first name, or the verdict where there is none.
        right: the kind's own question is answered right (see `judge`).
        extra: a name that is not true.
        says_so: of twins: the other one is listed as indistinguishable.
        dependency: of what is outside the library: a state on which it does depend is named.
        overlap: of `contact`: intersection over union of the windows.
        time_error: s, of `mass_step`.
        errors: relative error of each parameter, by effect and parameter.
        removed: share of the excess held-out error that the augmented model removes.
        stated: (probability, was it true) of each name.
        seconds: s that the tool took by its own account.
    """

    case: str
    kind: str
    truth: tuple[str, ...]
    strength: float
    answered: bool
    verdict: str
    named: tuple[str, ...]
    first: str
    right: bool
    extra: bool
    says_so: bool
    dependency: bool
    overlap: float | None
    time_error: float | None
    errors: dict[tuple[str, str], float]
    removed: float | None
    stated: tuple[tuple[float, bool], ...]
    seconds: float | None


def judge(case: str, label: Mapping[str, Any], answer: Mapping[str, Any] | None) -> Verdict:
    """Hold an answer (the JSON of `poise mismatch`, None: there is none) against the label.

    Right is: single: its effect is named first; pair: both are named; null, decoy: `none`; twin: one of the
    equivalent effects is named first; foreign: `unknown` or `mixed`.
    """
    answer = answer or {}
    kind, truth = label["kind"], tuple(effect["name"] for effect in label["effects"])
    effects = list(answer.get("effects") or [])
    named = tuple(effect["name"] for effect in effects)
    verdict = str(answer.get("verdict", ""))
    first = named[0] if named else verdict
    true_names = set(truth) | set(label["accept"])
    right = {
        "single": first in truth,
        "pair": set(truth) <= set(named),
        "null": verdict == "none",
        "decoy": verdict == "none",
        "twin": first in true_names,
        "foreign": verdict in ("unknown", "mixed"),
    }[kind]
    twins = set(effects[0].get("indistinguishable_from") or []) if effects else set()
    by_name = {effect["name"]: effect for effect in reversed(effects)}
    pairs = [(effect, by_name[effect["name"]]) for effect in label["effects"] if effect["name"] in by_name]
    return Verdict(
        case=case,
        kind=kind,
        truth=truth,
        strength=float(label["strength"]),
        answered=bool(answer),
        verdict=verdict,
        named=named,
        first=first,
        right=bool(answer) and right,
        extra=bool(set(named) - true_names),
        says_so=bool(twins & (true_names - {first})),
        dependency=bool(set(states_of(answer)) & set(label["depends_on"])),
        overlap=next((overlap(t["windows"], a.get("windows")) for t, a in pairs if t["name"] == "contact"), None),
        time_error=next((_time_error(t, a) for t, a in pairs if t["name"] == "mass_step"), None),
        errors={(t["name"], stem): error for t, a in pairs for stem, error in parameter_errors(t, a).items()},
        removed=removed_share(answer),
        stated=tuple(
            (float(effect["probability"]), effect["name"] in true_names)
            for effect in effects
            if not (kind == "foreign" and effect["name"] in label["accept"])
        ),
        seconds=float(answer["seconds"]) if "seconds" in answer else None,
    )


def states_of(answer: Mapping[str, Any]) -> list[str]:
    """The states that `unknown` depends on, in the words of `STATES`."""
    said = (answer.get("unknown") or {}).get("depends_on") or []
    entries = [said] if isinstance(said, str) else list(said)
    found = []
    for entry in entries:
        text = str(entry.get("state", "") if isinstance(entry, Mapping) else entry).split(":")[0].lower()
        found += [state for state, pattern in STATES.items() if re.search(pattern, text)][:1]
    return found


def overlap(truth: Sequence[Sequence[float]], answer: Sequence[Sequence[float]] | None) -> float:
    """Intersection over union of two sets of windows."""
    ends = [edge for windows in (truth, answer or []) for window in windows for edge in window]
    edges = np.unique(np.asarray(ends, dtype=np.float64))
    middles, lengths = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    inside = [_inside(middles, windows) for windows in (truth, answer or [])]
    union = float(lengths @ (inside[0] | inside[1]))
    return float(lengths @ (inside[0] & inside[1])) / union if union > 0 else 0.0


def parameter_errors(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, float]:
    """Relative error of each of an effect's main parameters that is in both; of vectors the norm of the difference."""
    stems: dict[str, list[str]] = {}
    for name in truth["parameters"]:
        stems.setdefault(AXIS.sub("", name), []).append(name)
    wanted = MAIN_PARAMETERS.get(truth["name"], tuple(stems))
    given = answer.get("parameters") or {}
    errors = {}
    for stem in wanted:
        names = stems.get(stem, [])
        true = np.array([truth["parameters"][name] for name in names])
        size = float(np.linalg.norm(true))
        if size < SMALLEST or not any(name in given for name in names):
            continue
        # Of a sparse vector (gains) an answer may leave out what is zero.
        said = np.array([_value(given[name]) if name in given else 0.0 for name in names])
        errors[stem] = float(np.linalg.norm(said - true)) / size
    return errors


def removed_share(answer: Mapping[str, Any]) -> float | None:
    """Share of the held-out error above the noise (squared whitened rms minus 1) that the augmented model removes."""
    holdout = (answer.get("fit") or {}).get("holdout") or {}
    if not {"nominal", "augmented"} <= holdout.keys():
        return None
    before, after = (float(holdout[key]) ** 2 - 1.0 for key in ("nominal", "augmented"))
    return 1.0 - max(after, 0.0) / before if before > 0.05 else None


def _inside(times: "np.ndarray[Any, np.dtype[np.float64]]", windows: Sequence[Sequence[float]]) -> Any:
    inside = np.zeros(len(times), dtype=bool)
    for start, end in windows:
        inside |= (times > start) & (times < end)
    return inside


def _time_error(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> float | None:
    given = (answer.get("parameters") or {}).get("time")
    return None if given is None else abs(_value(given) - truth["parameters"]["time"])


def _value(parameter: Any) -> float:
    return float(parameter["value"] if isinstance(parameter, Mapping) else parameter)

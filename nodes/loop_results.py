"""A loop as the content of loop.json, from which the table and the report are made."""

import math
from typing import Any

import numpy as np

from poise.nodes.loop_sequence import LoopRecord, ObjectRecord, WeighedObject

_SIGMAS = 3.0


def loop_content(
    record: LoopRecord, planning: float, restarts: dict[str, int], machine_seconds: float
) -> dict[str, Any]:
    """The content of loop.json.

    Args:
        record: of the loop.
        planning: s in which nodes planned and computed.
        restarts: how often each node was started again.
        machine_seconds: s of the machine that it took; the seconds of steps are of simulated time, where that is used.
    """
    carried = record.carried
    return {
        "complete": record.whole,
        "error": None if record.error is None else {"code": int(record.error.code), "name": record.error.code.name},
        "sentence": "" if record.error is None else record.error.message,
        "wanted": record.wanted,
        "objects": [_object(each) for each in record.objects],
        "carried": None if carried is None else carried._asdict(),
        "seconds": sum(step.seconds for step in record.steps),
        "machine_seconds": machine_seconds,
        "planning": planning,
        "restarts": {name: count for name, count in restarts.items() if count},
        "steps": [
            {
                "step": step.step,
                "object": step.name,
                "seconds": step.seconds,
                "code": int(step.code),
                "name": step.code.name,
                "sentence": step.message,
            }
            for step in record.steps
        ],
    }


def _object(known: ObjectRecord) -> dict[str, Any]:
    content: dict[str, Any] = {"id": known.name, "outcome": known.outcome, "why": known.why}
    strength = known.robustness
    content["robustness"] = strength if strength is not None and math.isfinite(strength) else None
    if known.weight is not None:
        content |= _weight(known.weight)
    return content


def _weight(weight: WeighedObject) -> dict[str, Any]:
    """Mass and centre of mass with their standard deviations, and how far they are off."""
    deviations = com_deviations(weight)
    content: dict[str, Any] = {
        "mass": weight.mass,
        "mass_std": math.sqrt(max(weight.covariance[0, 0], 0.0)),
        "com": weight.com.tolist(),
        "com_std": deviations.tolist(),
    }
    if weight.true_mass is None or weight.true_com is None:
        return content
    mass_off, com_off = weight.mass - weight.true_mass, weight.com - weight.true_com
    within = bool(abs(mass_off) <= _SIGMAS * content["mass_std"] and (np.abs(com_off) <= _SIGMAS * deviations).all())
    return content | {
        "true_mass": weight.true_mass,
        "true_com": weight.true_com.tolist(),
        "mass_error": mass_off / weight.true_mass,
        "com_error": float(np.linalg.norm(com_off)),
        "within": within,
    }


def com_deviations(weight: WeighedObject) -> Any:
    """(3,) m, one standard deviation of the centre of mass, from that of m and m c (first order)."""
    slope = np.hstack([-weight.com[:, None], np.eye(3)]) / weight.mass
    return np.sqrt(np.maximum(np.diag(slope @ weight.covariance @ slope.T), 0.0))

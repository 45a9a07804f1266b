"""Wrong model.yaml: units and axes of the payload, a payload that is not held, frames, gravity, noise."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.broken_inputs.way import Way, turning
from benchmarks.foreign.case import Case

Payload = dict[str, Any]


def _payload(change: Callable[[Payload], Payload]) -> Callable[[Case], Case]:
    return lambda case: replace(
        case, model=case.model | {"payload": case.model["payload"] | change(case.model["payload"])}
    )


def _scaled(entry: str, factor: float) -> Callable[[Case], Case]:
    return _payload(lambda payload: {entry: (factor * np.array(payload[entry])).tolist()})


def _entries(**entries: Any) -> Callable[[Case], Case]:
    return lambda case: replace(case, model=case.model | entries)


def _of_wrench(change: Callable[[Case], Case]) -> Callable[[Case], Case | None]:
    return lambda case: None if case.streams.wrench is None else change(case)


def _about_the_sensor(payload: Payload) -> Payload:
    """The inertia about the origin of the sensor, not about the centre of mass."""
    com = np.array(payload["com"])
    shift = payload["mass"] * (com @ com * np.eye(3) - np.outer(com, com))
    return {"inertia": (np.array(payload["inertia"]) + shift[np.triu_indices(3)]).tolist()}


def _in_axes_of_the_tool(payload: Payload) -> Payload:
    """Axes of a frame that is a quarter turned about the x axis."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    inertia = np.zeros((3, 3))
    inertia[np.triu_indices(3)] = payload["inertia"]
    inertia = turn @ (inertia + np.triu(inertia, 1).T) @ turn.T
    return {"com": (turn @ payload["com"]).tolist(), "inertia": inertia[np.triu_indices(3)].tolist()}


PAYLOAD = "payload_parameters"
WAYS = {
    "mass in g": Way(_scaled("mass", 1000.0), r"payload\.mass|payload of the model has another unit"),
    "mass in lb": Way(_scaled("mass", 2.2046226), "", PAYLOAD),
    "com in mm": Way(_scaled("com", 1000.0), r"payload\.com is .* give it in m"),
    "com in cm": Way(_scaled("com", 100.0), r"payload\.com is .* give it in m", PAYLOAD),
    "com of opposite sign": Way(turning(_scaled("com", -1.0)), r"payload\.com", PAYLOAD),
    "payload in axes of the tool": Way(turning(_payload(_in_axes_of_the_tool)), r"payload\.com", PAYLOAD),
    "inertia in kg cm2": Way(_scaled("inertia", 1e4), r"payload\.inertia is .* give it in kg m2", PAYLOAD),
    "inertia in g mm2": Way(_scaled("inertia", 1e9), r"payload\.inertia is .* give it in kg m2", PAYLOAD),
    "inertia about the sensor": Way(_payload(_about_the_sensor), "inertia", PAYLOAD, harmless=True),
    "half the load": Way(_scaled("mass", 0.5), "", PAYLOAD),
    "no load": Way(_entries(payload={"mass": 0.0}), "", PAYLOAD),
    "a frame that is not there": Way(_of_wrench(_entries(sensor_frame="tool")), "no frame"),
    "gravity in cm/s2": Way(_entries(gravity=980.665), "gravity"),
    "gravity of opposite sign": Way(_entries(gravity=-9.80665), "gravity"),
    "no gravity": Way(_entries(gravity=0.0), "gravity"),
    "noise a tenth": Way(_of_wrench(_entries(noise={"force": 0.01, "torque": 0.001})), "", harmless=True),
    "noise tenfold": Way(
        _of_wrench(_entries(noise={"force": 1.0, "torque": 0.1})), "noise of the|noise.force of", harmless=True
    ),
}

"""What is never quite right, on any robot: calibration errors inside the declared tolerances."""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.changes.base import Change
from benchmarks.concealed.changes.chain import Bias, Clock, Coarse, Encoders, Gain, Turned
from benchmarks.concealed.changes.weight import OtherPayload
from poise.types import Array


@dataclass(frozen=True)
class Tolerance:
    """What model.yaml declares good enough; see the issue and `poise.mismatch.reading.nominal_model`."""

    mass: float = 0.01
    com: float = 0.002
    inertia: float = 0.1
    bias: tuple[float, float] = (0.4, 0.025)
    drift: tuple[float, float] = (0.12, 0.008)
    gain: float = 0.01
    rotation: float = 0.004
    joint_offset: float = 0.001
    clock_offset: float = 0.004

    def document(self) -> dict[str, object]:
        """As model.yaml has it."""
        return {
            "payload": {"mass": self.mass, "com": self.com, "inertia": self.inertia},
            "sensor_bias": {"force": self.bias[0], "torque": self.bias[1]},
            "bias_drift": {"force": self.drift[0], "torque": self.drift[1]},
            "sensor_gain": self.gain,
            "sensor_rotation": self.rotation,
            "joint_offset": self.joint_offset,
            "clock_offset": self.clock_offset,
        }


TOLERANCE = Tolerance()
CROSS = 0.1  # of the tolerance of the gain: how much of it goes across axes
ROUNDING = np.repeat([0.01, 0.001], 3)  # N, N m: the steps of an FT-300's stream


def honest_errors(rng: np.random.Generator, leave: frozenset[str]) -> list[Change]:
    """One of each kind but those in `leave`, which a change sets itself."""
    errors = _all_errors(rng)
    return [error for group, error in errors.items() if group not in leave]


def _all_errors(rng: np.random.Generator) -> dict[str, Change]:
    """Everything is drawn always, so that what is left out does not change the rest."""
    limits = TOLERANCE
    gain = np.zeros((6, 6))
    for block in (slice(0, 3), slice(3, 6)):
        gain[block, block] = _within(rng, CROSS * limits.gain, (3, 3))
    gain[np.diag_indices(6)] = _within(rng, limits.gain, 6)
    payload = OtherPayload(
        mass=float(_within(rng, limits.mass, 1)[0]),
        com=_within(rng, limits.com, 3),
        inertia=float(_within(rng, limits.inertia, 1)[0]),
    )
    errors: dict[str, Change] = {
        "payload": payload,
        "bias": Bias(bias=_within(rng, np.repeat(limits.bias, 3), 6)),
        "drift": Bias(drift=_within(rng, np.repeat(limits.drift, 3), 6)),
        "gain": Gain(error=gain),
        "rotation": Turned(rotation=_within(rng, limits.rotation, 3)),
        "joints": Encoders(offset=_within(rng, limits.joint_offset, 6)),
        "clock": Clock(offset=float(_within(rng, limits.clock_offset, 1)[0])),
    }
    if rng.random() < 0.5:
        errors["rounding"] = Coarse(steps=ROUNDING)
    return errors


def _within(rng: np.random.Generator, limit: float | Array, shape: int | tuple[int, ...]) -> Array:
    """Normal with half the limit for one sigma, cut at the limit."""
    return np.clip(rng.normal(size=shape) * 0.5, -1.0, 1.0) * limit

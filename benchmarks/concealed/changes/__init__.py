"""Everything that may be wrong in a case, by name.

- `base`: `Change`, the hooks. `weight`, `moving`, `outside`, `ground`, `chain`, `friction`: the effects of the library.
- `foreign`: physics outside the library. `decoys`: what is odd but no physics. `honest`: what is never quite right.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.concealed.changes import chain, decoys, foreign, friction, ground, moving, outside, weight
from benchmarks.concealed.changes.base import Change

Draw = Callable[[Any, float, np.random.Generator], Change]
"""(scene, strength, rng) -> the change, with its label."""


def _named(module: object, *names: str) -> dict[str, Draw]:
    return {name: getattr(module, name) for name in names}


WRENCH_EFFECTS: dict[str, Draw] = {
    **_named(chain, "sensor_bias", "bias_drift", "sensor_creep", "sensor_gain", "sensor_nonlinearity"),
    **_named(chain, "sensor_rotation", "quantisation", "saturation", "low_pass", "clock_offset", "clock_skew"),
    **_named(ground, "base_tilt", "base_motion"),
    **_named(chain, "joint_offset"),
    **_named(weight, "payload_parameters", "mass_step", "mass_leak"),
    **_named(outside, "world_force", "cable", "air_drag"),
    **_named(moving, "slosh", "hanging_chain", "loose_part", "grasp_compliance", "flexible_mode", "flywheel"),
    **_named(outside, "contact"),
    **_named(ground, "external_vibration"),
}
EFFORT_EFFECTS = _named(
    friction,
    *("viscous_friction", "coulomb_friction", "stribeck_friction", "load_dependent_friction"),
    *("joint_coupling", "gear_ripple", "backlash", "motor_inertia"),
)
LIBRARY = WRENCH_EFFECTS | EFFORT_EFFECTS

WRENCH_UNKNOWNS = _named(
    foreign,
    *("magnetic_pull", "wind_gusts", "rope_drag", "pump", "grasp_slip", "spinning_up_rotor", "thermal_gain"),
    *("bouc_wen", "hum_by_speed", "cable_chain", "drive_interference", "housing_strain"),
)
EFFORT_UNKNOWNS = _named(foreign, "warming_grease", "hose_spring")
UNKNOWNS = WRENCH_UNKNOWNS | EFFORT_UNKNOWNS

DEPENDS_ON: dict[str, tuple[str, ...]] = {
    "magnetic_pull": ("joint_position",),
    "wind_gusts": ("time",),
    "rope_drag": ("joint_velocity",),
    "pump": ("time",),
    "grasp_slip": ("gravity_direction", "load", "time"),
    "spinning_up_rotor": ("time", "joint_velocity"),
    "thermal_gain": ("load", "time"),
    "bouc_wen": ("load", "gravity_direction"),
    "hum_by_speed": ("joint_velocity",),
    "cable_chain": ("joint_position",),
    "drive_interference": ("base_acceleration",),
    "housing_strain": ("gravity_direction",),
    "warming_grease": ("time", "joint_velocity"),
    "hose_spring": ("joint_position",),
}
"""States on which what is outside the library depends; naming any one of them is right."""

DECOYS = _named(decoys, "dropped_samples", "outliers", "loud_noise", "clock_jitter", "swaying_floor", "unusual_motion")

AKIN: dict[str, tuple[str, ...]] = {
    "spinning_up_rotor": ("flywheel",),
    "thermal_gain": ("sensor_gain", "gain_drift"),
    "grasp_slip": ("loose_part", "flexible_mode"),
    "rope_drag": ("air_drag",),
    "warming_grease": ("viscous_friction",),
}
"""Names of the library that explain a part of what is outside it: beside `unknown` they are no mistake."""

EVERYTHING = LIBRARY | UNKNOWNS | DECOYS

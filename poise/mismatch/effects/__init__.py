"""The library of effects: one file for each, discovered in this folder.

- `base`: `Effect`, `EffectParameter`: the base classes of an effect.
- `drift`, `joint_friction`, `knocks`, `load_changes`, `part_motion`, `part_wrench`, `recorded_channels`, `starts`,
  `stops`, `accelerometer_input`: shared by several effects.
- every other file: one effect.
"""

from functools import cache

from poise.mismatch.effects.accelerometer_input import SLOWEST_VIBRATION, slow_part
from poise.mismatch.effects.base import LAYERS, Effect, EffectParameter, Values
from poise.mismatch.effects.base_motion import FEWEST_SPLINES, MAX_SPLINES, UnreportedBaseMotion
from poise.mismatch.effects.base_tilt import tilt_columns
from poise.mismatch.effects.external_vibration import ExternalVibration
from poise.mismatch.effects.joint_friction import (
    COULOMB_TRANSITION,
    bristles_along,
    in_model,
    joint_unit,
    laws_of_dry_friction,
    like_a_turned_base,
    numbered_joints,
    soft_ramp,
    stated_sense,
)
from poise.mismatch.effects.joint_offset import joint_columns
from poise.mismatch.effects.payload_parameters import PAYLOAD_PARAMETERS
from poise.mismatch.effects.saturation import at_ends, exceeded, limited_readings
from poise.mismatch.effects.sensor_gain import GAIN_LEVER
from poise.mismatch.effects.sensor_rotation import rotation_columns
from poise.mismatch.effects.starts import within
from poise.registry import entries_of

__all__ = [
    "COULOMB_TRANSITION",
    "FEWEST_SPLINES",
    "GAIN_LEVER",
    "LAYERS",
    "MAX_SPLINES",
    "PAYLOAD_PARAMETERS",
    "SLOWEST_VIBRATION",
    "Effect",
    "EffectParameter",
    "ExternalVibration",
    "UnreportedBaseMotion",
    "Values",
    "all_effects",
    "at_ends",
    "bristles_along",
    "effect_named",
    "exceeded",
    "in_model",
    "joint_columns",
    "joint_unit",
    "laws_of_dry_friction",
    "like_a_turned_base",
    "limited_readings",
    "numbered_joints",
    "rotation_columns",
    "slow_part",
    "soft_ramp",
    "stated_sense",
    "tilt_columns",
    "within",
]


@cache
def all_effects() -> tuple[Effect, ...]:
    """Every effect of the library, by layer and name."""
    found: tuple[Effect, ...] = entries_of(__name__, __path__, Effect)  # type: ignore[type-abstract]
    return tuple(sorted(found, key=lambda effect: (LAYERS.index(effect.layer), effect.name)))


def effect_named(name: str) -> Effect | None:
    """The effect of a name, or None."""
    return next((effect for effect in all_effects() if effect.name == name), None)

"""A scene on a base that moves: when something on it slipped or tipped, held against the assembly engine.

- `recorded`: the acceleration of the base and the tracks of the objects, from tf. `events`: what moved, and when.
- `prediction`: the load of a scene. `causes`: what a scene may have wrong. `answer`: the likeliest cause.
"""

from poise.mismatch.carried.answer import CarriedAnswer, CarriedEffect, examine_carried
from poise.mismatch.carried.events import CarriedMotion
from poise.mismatch.carried.recorded import CarriedRecording, read_carried

__all__ = ["CarriedAnswer", "CarriedEffect", "CarriedMotion", "CarriedRecording", "examine_carried", "read_carried"]

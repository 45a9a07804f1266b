"""How hard objects in frictional contact can be pushed, how fast they can be carried, and how to take them apart.

- `load_scene`, `Assembly`, `RigidObject`: the objects. `Analysis`: an assembly prepared for many queries.
- `settle`: the most likely poses that touch, of poses that a camera sees; `assess_settled`: answers with intervals.
- `assess`: robustness to pushes. `robustness_map`: robustness at points all over the surface.
- `sensitivity`, `motion_probability`: derivatives of robustness, and the probability that something moves.
- `acceleration_limits`: how fast a base that carries the objects may accelerate. `plan_disassembly`: order of removal.

Rooms, from the ground up: `scene`, `contact`, `settling`, `statics`, `robustness`, `models`.
"""

from poise.assembly.robustness import (
    acceleration_limits,
    assess,
    assess_settled,
    motion_probability,
    plan_disassembly,
    robustness_map,
    sensitivity,
)
from poise.assembly.scene import (
    Assembly,
    Box,
    Cylinder,
    FrictionPair,
    Mesh,
    RigidObject,
    Sphere,
    load_scene,
    write_scene,
)
from poise.assembly.settling import Settled, settle
from poise.assembly.statics import Analysis, Push

__all__ = [
    "Analysis",
    "Assembly",
    "Box",
    "Cylinder",
    "FrictionPair",
    "Mesh",
    "Push",
    "RigidObject",
    "Settled",
    "Sphere",
    "acceleration_limits",
    "assess",
    "assess_settled",
    "load_scene",
    "motion_probability",
    "plan_disassembly",
    "robustness_map",
    "sensitivity",
    "settle",
    "write_scene",
]

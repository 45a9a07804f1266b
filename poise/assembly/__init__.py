"""How hard objects in frictional contact may be pushed and carried, and in which order they may be taken apart.

- `load_scene`, `Assembly`, `RigidObject`: what touches what.
- `assess`: the robustness to single pushes, or to several at once. `robustness_map`: to pushes all over the surface.
- `sensitivity`, `motion_probability`: what the robustness depends on, and how sure it is.
- `acceleration_limits`: how fast a base that carries the objects may accelerate, turn and tilt.
- `plan_disassembly`: in which order they can be taken away.
- `Analysis`: an assembly made ready for many questions, and for changes of single objects.
"""

from poise.assembly.acceleration import AccelerationLimits, acceleration_limits
from poise.assembly.analysis import Analysis, Mechanism
from poise.assembly.assess import Assessment, Robustness, assess
from poise.assembly.contacts import CONTACT_MARGIN, Interface, find_interfaces
from poise.assembly.disassembly import Disassembly, plan_disassembly
from poise.assembly.graph import Structure
from poise.assembly.maps import MAX_MAP_POINTS, RobustnessMap, robustness_map
from poise.assembly.models import MODELS
from poise.assembly.pushes import Push
from poise.assembly.scene import Assembly, FrictionPair, RigidObject
from poise.assembly.scene_files import load_scene, read_object, read_scene, scene_content, write_scene
from poise.assembly.sensitivity import Sensitivity, sensitivity
from poise.assembly.shapes import Box, Cylinder, Mesh
from poise.assembly.surface import SurfacePoints, sample_surface
from poise.assembly.uncertainty import MotionProbability, motion_probability

__all__ = [
    "CONTACT_MARGIN",
    "MAX_MAP_POINTS",
    "MODELS",
    "AccelerationLimits",
    "Analysis",
    "Assembly",
    "Assessment",
    "Box",
    "Cylinder",
    "Disassembly",
    "FrictionPair",
    "Interface",
    "Mechanism",
    "Mesh",
    "MotionProbability",
    "Push",
    "RigidObject",
    "Robustness",
    "RobustnessMap",
    "Sensitivity",
    "Structure",
    "SurfacePoints",
    "acceleration_limits",
    "assess",
    "find_interfaces",
    "load_scene",
    "motion_probability",
    "plan_disassembly",
    "read_object",
    "read_scene",
    "robustness_map",
    "sample_surface",
    "scene_content",
    "sensitivity",
    "write_scene",
]

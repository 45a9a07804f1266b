"""How hard objects in frictional contact may be pushed and carried, and in which order they may be taken apart.

- `load_scene`, `Assembly`, `RigidObject`: what touches what.
- `assess`: the robustness to single pushes. `robustness_map`: to pushes all over the surface.
- `Analysis`: an assembly made ready for many questions.
"""

from poise.assembly.analysis import Analysis, Mechanism
from poise.assembly.assess import Assessment, Robustness, assess
from poise.assembly.contacts import CONTACT_MARGIN, Interface, find_interfaces
from poise.assembly.geometry import Pose
from poise.assembly.graph import Structure
from poise.assembly.maps import RobustnessMap, robustness_map
from poise.assembly.models import MODELS
from poise.assembly.pushes import Push
from poise.assembly.scene import Assembly, FrictionPair, RigidObject
from poise.assembly.scene_files import load_scene, read_object, read_scene, scene_content, write_scene
from poise.assembly.shapes import Box, Cylinder, Mesh
from poise.assembly.surface import SurfacePoints, sample_surface

__all__ = [
    "CONTACT_MARGIN",
    "MODELS",
    "Analysis",
    "Assembly",
    "Assessment",
    "Box",
    "Cylinder",
    "FrictionPair",
    "Interface",
    "Mechanism",
    "Mesh",
    "Pose",
    "Push",
    "RigidObject",
    "Robustness",
    "RobustnessMap",
    "Structure",
    "SurfacePoints",
    "assess",
    "find_interfaces",
    "load_scene",
    "read_object",
    "read_scene",
    "robustness_map",
    "sample_surface",
    "scene_content",
    "write_scene",
]

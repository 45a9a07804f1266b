"""What an assembly is made of: rigid objects with their shapes, friction and gravity, and the files they come from.

- `shapes`, `mesh_files`, `hulls`: boxes, cylinders, spheres and closed meshes as polyhedra, and their convex hulls.
- `scene`: `RigidObject`, `FrictionPair` and `Assembly`. `scene_files`: YAML in and out.
- `plausibility`: what in a scene is probably wrong.
"""

from poise.assembly.scene.hulls import hull_of
from poise.assembly.scene.mesh_files import load_mesh
from poise.assembly.scene.plausibility import MATTER, SceneFinding, scene_findings
from poise.assembly.scene.scene import ROLLING, Assembly, FrictionPair, RigidObject, check_density
from poise.assembly.scene.scene_files import (
    load_scene,
    pose_covariance_of,
    read_object,
    read_scene,
    scene_content,
    with_pose_covariance,
    write_scene,
)
from poise.assembly.scene.shapes import Box, Cylinder, Mesh, Polyhedron, Shape, Sphere

__all__ = [
    "MATTER",
    "ROLLING",
    "Assembly",
    "Box",
    "Cylinder",
    "FrictionPair",
    "Mesh",
    "Polyhedron",
    "RigidObject",
    "SceneFinding",
    "Shape",
    "Sphere",
    "check_density",
    "hull_of",
    "load_mesh",
    "load_scene",
    "pose_covariance_of",
    "read_object",
    "read_scene",
    "scene_content",
    "scene_findings",
    "with_pose_covariance",
    "write_scene",
]

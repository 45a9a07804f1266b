"""Shapes of objects: from point clouds and meshes to closed solids and their parts.

- `clouds`, `meshes`: files and messages are read, checked and repaired within limits.
- `carving`, `surface_fit`, `matching`, `reconstruction`: the closed tetrahedral solid that explains noisy points.
  `gaps`: narrow ones that a scan saw through.
- `missing`, `reflections`: surface that a cloud does not show, or shows twice.
- `segmentation`: a solid cut into parts that likely have one density. `mesh_parts`: the same of a mesh.
- `independent`: at most four parts whose masses a sensor at rest distinguishes.
- `part_surfaces`, `surface_files`: output of parts and surfaces.
"""

from poise.shape.clouds import Cloud, read_cloud
from poise.shape.grouping import linked
from poise.shape.independent import independent_parts
from poise.shape.mesh_clouds import read_surface
from poise.shape.mesh_parts import segment_surface
from poise.shape.meshes import MESH_FORMATS, CheckedMesh, check_mesh, read_mesh, read_triangles
from poise.shape.part_surfaces import part_surface
from poise.shape.reconstruction import HIDDEN_OFF
from poise.shape.segmentation import DEFAULT_SEGMENTATION, Segmentation, SegmentationOptions, segment
from poise.shape.solid import Solid, tetrahedron_moments
from poise.shape.surface_files import colour_of, labelled_ply, surface_ply

__all__ = [
    "DEFAULT_SEGMENTATION",
    "HIDDEN_OFF",
    "MESH_FORMATS",
    "CheckedMesh",
    "Cloud",
    "Segmentation",
    "SegmentationOptions",
    "Solid",
    "check_mesh",
    "colour_of",
    "independent_parts",
    "labelled_ply",
    "linked",
    "part_surface",
    "read_cloud",
    "read_mesh",
    "read_surface",
    "read_triangles",
    "segment",
    "segment_surface",
    "surface_ply",
    "tetrahedron_moments",
]

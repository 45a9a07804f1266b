"""Meshes of objects as STL files beside a scene or a world."""

from io import BytesIO

import trimesh

from poise.assembly.scene import Mesh, Polyhedron


def stl_name(stem: str, item: str) -> str:
    """Of the mesh of an object beside a file."""
    safe = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in item)
    return f"{stem}_{safe}.stl"


def stl_bytes(surface: Polyhedron | Mesh) -> bytes:
    """A surface as binary STL, m."""
    file = BytesIO()
    trimesh.Trimesh(surface.vertices, surface.triangles, process=False).export(file, file_type="stl")
    return file.getvalue()

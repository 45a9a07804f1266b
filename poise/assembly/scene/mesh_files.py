"""Mesh files of a scene as shapes; `poise.shape.meshes` reads, checks and repairs them."""

from pathlib import Path

from poise.assembly.scene.shapes import Mesh
from poise.shape import read_mesh


def load_mesh(source: str, folder: Path = Path(), scale: float = 1.0) -> Mesh:
    """Read a closed mesh, in m after scaling.

    Args:
        source: a path (relative ones are inside `folder`) or package://NAME/path.
        folder: of the scene file.
        scale: factor from the file's unit to m (0.001 for mm).

    Raises:
        InputError: as `poise.shape.meshes.read_mesh`, naming the file.
    """
    mesh = read_mesh(source, folder, scale)
    return Mesh(mesh.vertices, mesh.triangles, source=source, scale=scale, notes=mesh.notes)

"""Objects of PyBullet on a table, seen by a stereo camera that matches two infrared images.

No renderer or error model of Poise is used. PyBullet settles and renders the objects, and OpenCV's block matching
measures disparity between a left and a right image of a projected dot pattern. So the errors of depth have the causes
that they have in an active stereo camera: the window of the matching grows foreground over its edges and smooths
corners, sub-pixel fits prefer whole pixels, dark and grazing surfaces give no depth, and mirrors of the projector
saturate.
"""

import importlib.util
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from poise.scanning import Camera
from poise.types import Array, Mask

CAMERA = Camera(640, 480, 385.0, 385.0, 321.7, 238.4)
"""The left infrared camera of a D435, to which its depth belongs."""
BASELINE = 0.05
PROJECTOR = 0.029
"""m, right of the left camera."""
TABLE = 0.4
"""m, half a side."""
_NEAR, _FAR = 0.05, 3.0
_NAMED = (
    "duck.obj", "bunny.obj", "torus/torus_textured.obj", "stone.obj", "domino/domino.obj", "lego/lego.obj",
    "tray/tray_textured.obj", "objects/mug.obj", "toys/prism.obj", "toys/cylinder.obj", "toys/concave_box.obj",
    "teddy2_VHACD_CHs.obj",
)  # fmt: skip
_FILLED = 0.02
"""Share of hidden hollows up to which an object is used: no camera sees them."""


def data_folder() -> Path:
    """Of pybullet_data.

    Raises:
        SystemExit: it is not installed.
    """
    found = importlib.util.find_spec("pybullet_data")
    if found is None or found.origin is None:
        raise SystemExit("pybullet_data is not installed: pip install pybullet")
    return Path(found.origin).parent


@dataclass(frozen=True, eq=False)
class Shape:
    """A closed mesh, or several that overlap.

    Args:
        name: file below pybullet_data.
        vertices: (V, 3) m.
        triangles: (T, 3).
    """

    name: str
    vertices: Array
    triangles: NDArray[np.int64]

    @cached_property
    def columns(self) -> tuple[Mask, float, Array]:
        """(X, Y, Z) what is inside on a grid; volume, m3, and centre, (3,) m.

        Along z the crossings of each column with the triangles are exact; a place is inside where they wind around it.
        """
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        step = float((high - low).max()) / 256
        counts = np.ceil((high - low) / step).astype(int)
        winding = np.zeros((counts[0], counts[1], counts[2] + 1))
        x, y = (low[axis] + (np.arange(counts[axis]) + 0.5003) * step for axis in (0, 1))
        for corner in self.vertices[self.triangles]:
            (i, j), (k, m) = (
                np.searchsorted(x, [corner[:, 0].min(), corner[:, 0].max()]),
                np.searchsorted(y, [corner[:, 1].min(), corner[:, 1].max()]),
            )
            one, two = (corner[1:] - corner[0])[:, :2]
            twice = one[0] * two[1] - one[1] * two[0]
            if twice == 0 or i == j or k == m:
                continue
            dx, dy = x[i:j, None] - corner[0, 0], y[None, k:m] - corner[0, 1]
            a, b = (dx * two[1] - dy * two[0]) / twice, (dy * one[0] - dx * one[1]) / twice
            hit = (a >= 0) & (b >= 0) & (a + b < 1)
            z = corner[0, 2] + a * (corner[1, 2] - corner[0, 2]) + b * (corner[2, 2] - corner[0, 2])
            cell = np.clip(np.ceil((z - low[2]) / step - 0.5), 0, counts[2]).astype(int)
            at = np.nonzero(hit)
            winding[at[0] + i, at[1] + k, cell[at]] -= np.sign(twice)
        inside = np.abs(np.cumsum(winding, axis=2)[..., :-1]) > 0.5
        middle = np.argwhere(inside).mean(axis=0) + 0.5
        return inside, float(inside.sum()) * step**3, low + step * middle

    @property
    def hidden(self) -> float:
        """Share of hollows that nothing reaches from outside through more than 1/128 of the length."""
        inside = self.columns[0]
        padded = np.pad(inside, 3)
        closed = ndimage.binary_fill_holes(ndimage.binary_closing(padded, iterations=1))
        return float(closed.sum() / inside.sum() - 1)


def shape(name: str, length: float) -> Shape:
    """A mesh of pybullet_data, scaled to a length, m, of its longest side."""
    import trimesh

    mesh = trimesh.load(data_folder() / name, force="mesh", process=False)
    vertices = np.asarray(mesh.vertices, float)
    scale = length / float(np.ptp(vertices, axis=0).max())
    return Shape(name, scale * vertices, np.asarray(mesh.faces, np.int64))


def draw_shape(seed: int, rng: np.random.Generator) -> Shape:
    """Every third one is a named thing; the others are random objects without hidden hollows."""
    length = float(rng.uniform(0.06, 0.22))
    if seed % 3 == 0:
        return shape(_NAMED[seed // 3 % len(_NAMED)], length)
    while True:
        number = int(rng.integers(1000))
        made = shape(f"random_urdfs/{number:03d}/{number:03d}.obj", length)
        if made.hidden < _FILLED and made.columns[0].mean() > 0.03:
            return made


@dataclass(frozen=True, eq=False)
class Paint:
    """How bright a surface is.

    Args:
        albedo: (2,) 0..1 of infrared, on both sides of a plane through the object.
        gloss: share of the light that is mirrored.
        border: (3,) normal of that plane.
        colours: (2, 3) 0..1.
    """

    albedo: Array
    gloss: float
    border: Array
    colours: Array


def draw_paint(rng: np.random.Generator) -> Paint:
    """One in three has two colours, one in four is dark on a side, one in three is glossy."""
    albedo = np.full(2, rng.uniform(0.35, 0.9))
    colours = np.tile(rng.uniform(0.15, 0.9, 3), (2, 1))
    if rng.random() < 1 / 3:
        colours[1] = rng.uniform(0.15, 0.9, 3)
    if rng.random() < 1 / 4:
        albedo[1] = rng.uniform(0.03, 0.1)
        colours[1] *= 0.3
    border = rng.normal(size=3)
    return Paint(albedo, float(rng.choice([0.0, 0.0, 0.6])), border / np.linalg.norm(border), colours)


class World:
    """An object at rest on a table, in PyBullet.

    Args:
        made: the object.
        paint: of it.
        rng: draws how it falls.
    """

    def __init__(self, made: Shape, paint: Paint, rng: np.random.Generator) -> None:
        import pybullet

        self._bullet: Any = pybullet
        self._client = pybullet.connect(pybullet.DIRECT)
        self.paint = paint
        self.volume = made.columns[1]
        try:
            self.vertices = self._settled(made, rng)
            self._show(self.vertices, made.triangles)
        except pybullet.error:
            self.close()
            raise

    def close(self) -> None:
        """Disconnect."""
        self._bullet.disconnect(self._client)

    def _settled(self, made: Shape, rng: np.random.Generator) -> Array:
        """(V, 3) m of the vertices at rest: the hull of the object rolls until it lies."""
        p, client = self._bullet, self._client
        p.setGravity(0, 0, -9.81, physicsClientId=client)
        floor = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client)
        p.createMultiBody(0, floor, physicsClientId=client)
        points = made.vertices - made.columns[2]
        scale = 10.0  # contact margins of the engine are small beside it
        hull = p.createCollisionShape(p.GEOM_MESH, vertices=(scale * points).tolist(), physicsClientId=client)
        start = Rotation.random(random_state=int(rng.integers(1 << 31))).as_quat()
        high = scale * float(np.linalg.norm(points, axis=1).max())
        body = p.createMultiBody(1.0, hull, -1, (0, 0, high), start, physicsClientId=client)
        p.changeDynamics(body, -1, lateralFriction=0.8, rollingFriction=0.01 * high, physicsClientId=client)
        for _ in range(2400):
            p.stepSimulation(physicsClientId=client)
        turn = Rotation.from_quat(p.getBasePositionAndOrientation(body, physicsClientId=client)[1])
        p.resetSimulation(physicsClientId=client)
        placed = turn.apply(points)
        low, top = placed.min(axis=0), placed.max(axis=0)
        return np.asarray(placed - [(low[0] + top[0]) / 2, (low[1] + top[1]) / 2, low[2]])

    def _show(self, vertices: Array, triangles: NDArray[np.int64]) -> None:
        p = self._bullet
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "object.obj"
            lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in vertices]
            lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
            path.write_text("\n".join(lines), encoding="ascii")
            seen = p.createVisualShape(p.GEOM_MESH, fileName=str(path), physicsClientId=self._client)
            p.createMultiBody(0, -1, seen, physicsClientId=self._client)

    # ---- images ----

    def depth(self, rotation: Array, translation: Array) -> tuple[Array, Mask]:
        """(H, W) m along the axis, 0 where nothing is; and where it is the object.

        Args:
            rotation: (3, 3) of the optical frame in the world.
            translation: (3,) m.
        """
        p, c = self._bullet, CAMERA
        view = np.eye(4)
        view[:3, :3] = np.diag([1.0, -1, -1]) @ rotation.T
        view[:3, 3] = -view[:3, :3] @ translation
        lens = np.zeros((4, 4))
        lens[0, 0], lens[0, 2] = 2 * c.fx / c.width, 1 - 2 * (c.cx + 0.5) / c.width
        lens[1, 1], lens[1, 2] = 2 * c.fy / c.height, 2 * (c.cy + 0.5) / c.height - 1
        lens[2, 2:] = -(_FAR + _NEAR) / (_FAR - _NEAR), -2 * _FAR * _NEAR / (_FAR - _NEAR)
        lens[3, 2] = -1
        image = p.getCameraImage(
            c.width, c.height, view.T.ravel().tolist(), lens.T.ravel().tolist(),
            renderer=p.ER_TINY_RENDERER, shadow=0, physicsClientId=self._client,
        )  # fmt: skip
        buffer = np.reshape(image[3], (c.height, c.width)).astype(float)
        object_ = np.reshape(image[4], (c.height, c.width)) >= 0
        z = _FAR * _NEAR / (_FAR - (_FAR - _NEAR) * buffer)
        rays = rays_of_camera() @ rotation.T
        with np.errstate(divide="ignore"):
            table = -translation[2] / rays[..., 2]
        at = translation + table[..., None] * rays
        flat = (table > 0) & (np.abs(at[..., :2]) < TABLE).all(axis=-1)
        table = np.where(flat, table, 0.0)
        return np.where(object_, z, table), object_


def rays_of_camera() -> Array:
    """(H, W, 3) through the middles of pixels, at a depth of 1."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width].astype(float)
    return np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)

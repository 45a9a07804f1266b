"""MJCF, the models of MuJoCo; MuJoCo itself reads them (extra `sim`)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import trimesh
from scipy.spatial import QhullError

from poise.assembly import Assembly, FrictionPair, Mesh
from poise.assembly.scene import Shape
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_of_quaternion
from poise.inertia import InertialParameters
from poise.shape import check_mesh
from poise.types import Array
from poise.worlds import solids
from poise.worlds.base import WorldBody, WorldContent, WorldFormat, WorldSolid
from poise.worlds.groups import WorldLink, grouped
from poise.worlds.mjcf_contacts import mjcf_friction
from poise.worlds.mjcf_text import MJCF_MEMORY, mjcf_geom, mjcf_inertial, mjcf_place, mjcf_resistance, mjcf_round_pairs

_FREE = 0
"""mjtJoint of a body that moves freely."""


class MjcfFormat(WorldFormat):
    """A model as it is at its start; the coefficient of two surfaces is the greater one, as in MuJoCo."""

    name = "mjcf"
    description = "MJCF, the models of MuJoCo"
    suffixes = (".xml", ".mjcf")

    def recognises(self, head: bytes) -> bool:
        """See `WorldFormat`."""
        return b"<mujoco" in head

    def read(self, path: Path) -> WorldContent:
        """See `WorldFormat`.

        Raises:
            InputError: also UNSUPPORTED without MuJoCo.
        """
        model, data = _compiled(path)
        return _Reading(model, data).content()

    def written(self, assembly: Assembly, path: Path) -> tuple[bytes, tuple[str, ...]]:
        """See `WorldFormat`. What is not convex becomes convex pieces; meshes are in the file."""
        friction = assembly.largest_friction if assembly.friction is None else assembly.friction
        bodies, meshes, lost, geoms = [], [], list[str](), dict[str, list[str]]()
        for item in assembly.objects:
            (spin, roll), dimensions = mjcf_resistance([item], assembly.rolling, friction)
            attributes = f'friction="{friction!r} {spin!r} {roll!r}" condim="{dimensions}"'
            geom, mesh, hull = mjcf_geom(item, escape(item.id, {'"': "&quot;"}), attributes)
            geoms[item.id] = [part.partition('"')[0] for part in geom.split('name="')[1:]]
            meshes.append(mesh)
            if hull:
                lost.append(f"{item.id}: too round to cut into convex pieces; its convex hull is written")
            inside = geom if item.fixed else f"<freejoint/>{mjcf_inertial(item)}{geom}"
            bodies.append(f"    <body name={quoteattr(item.id)} {mjcf_place(item.pose)}>{inside}</body>\n")
        pairs = "".join(
            f'<pair geom1="{one}" geom2="{other}" {_pair_friction(assembly, p)}/>'
            for p in (*assembly.friction_pairs, *mjcf_round_pairs(assembly, friction))
            for one in geoms[p.objects[0]]
            for other in geoms[p.objects[1]]
        )
        gravity = " ".join(repr(float(value)) for value in assembly.gravity)
        remarks = "".join(f"\n  not written: {each}" for each in lost).replace("--", "- -")
        text = f"""<!-- a scene of Poise{remarks} -->
<mujoco model={quoteattr(path.stem)}>
  <size memory="{MJCF_MEMORY if sum(map(len, geoms.values())) > _MANY else -1}"/>
  <option timestep="0.001" gravity="{gravity}" cone="elliptic" impratio="100" noslip_iterations="5"/>
  <default><geom solref="0.004 1"/></default>
  <asset>{"".join(meshes)}</asset>
  <worldbody>
    <light pos="0 0 4"/>
{"".join(bodies)}  </worldbody>
  <contact>{pairs}</contact>
</mujoco>
"""
        return text.encode(), tuple(lost)


_FRICTION = 1.0
"""Of geoms that give none."""
_MANY = 50
"""Of more geoms than that MuJoCo gets room for their contacts."""


def _compiled(path: Path) -> tuple[Any, Any]:
    try:
        import mujoco
    except ImportError as error:
        what = f"{path}: MuJoCo reads MJCF, and is not installed: pip install 'poise[sim]'"
        raise InputError(ErrorCode.UNSUPPORTED, what) from error
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(ErrorCode.FILE_CORRUPT, f"{path}: {' '.join(str(error).split())}") from error
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _left_out(model: Any) -> list[str]:
    """What moves or holds bodies in MuJoCo, and is not part of a scene."""
    counts = {
        "equality constraints (welds, connections) are left out: what they join is not joined": int(
            np.sum(model.eq_active0)
        ),
        "excluded pairs of bodies are left out: they touch here": int(model.nexclude),
        "keyframes are left out: bodies are where they are without one": int(model.nkey),
        "bodies have gravity compensation, which is left out: they have their weight": int(
            np.sum(model.body_gravcomp != 0)
        ),
    }
    return [f"{count} {what}" for what, count in counts.items() if count]


class _Reading:
    """A compiled model at its start."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self._notes: list[str] = []
        self._names = [model.body(i).name or f"body {i}" for i in range(model.nbody)]

    def content(self) -> WorldContent:
        """The bodies of the world, and what stands in the worldbody itself."""
        model = self._model
        bodies = [self._alone(number) for number in range(model.ngeom) if model.geom_bodyid[number] == 0]
        known = [body for body in bodies if body is not None]
        for root in range(1, model.nbody):
            if self._root(root) == root:
                known += self._rigid(root)
        pairs = self._pairs(known)
        default = sum(solid.friction == _FRICTION for body in known for solid in body.solids)
        doubt = f"friction of {default} geoms is {_FRICTION:g}, the default of MuJoCo; is it known?" if default else ""
        self._notes += _left_out(model)
        return WorldContent(tuple(known), self._gravity(), max, pairs, tuple(self._notes), friction_note=doubt)

    def _gravity(self) -> Array:
        import mujoco

        off = bool(self._model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        return np.zeros(3) if off else np.array(self._model.opt.gravity)

    def _pairs(self, bodies: Sequence[WorldBody]) -> dict[tuple[str, str], float]:
        """Coefficients of pairs of bodies that are not the greater one of both; `pair` says the last word."""
        model, names = self._model, {body.name for body in bodies}
        geoms = [geom for geom in range(model.ngeom) if self._touches(geom) and self._owner(geom) in names]
        owners, movable = [self._owner(geom) for geom in geoms], {body.name for body in bodies if not body.fixed}
        pairs, notes = mjcf_friction(model, geoms, owners, movable)
        self._notes += notes
        for number in range(model.npair):
            one, other = self._owner(int(model.pair_geom1[number])), self._owner(int(model.pair_geom2[number]))
            pairs.pop((other, one), None)
            slippery = model.pair_dim[number] == 1
            pairs[one, other] = 0.0 if slippery else float(min(model.pair_friction[number][:2]))
        return pairs

    def _touches(self, geom: int) -> bool:
        return bool(self._model.geom_contype[geom] or self._model.geom_conaffinity[geom])

    def _owner(self, geom: int) -> str:
        """The name of the body that a geom belongs to in `content`."""
        body = int(self._model.geom_bodyid[geom])
        return self._geom_name(geom) if body == 0 else self._names[self._root(body)]

    def _root(self, body: int) -> int:
        """The body that a body is one with: what a body with a free joint carries by other joints is rigid."""
        top = int(self._model.body_rootid[body])
        if self._free(top):
            return top
        weld = int(self._model.body_weldid[body])
        while weld == 0 and self._model.body_parentid[body] != 0:
            body = int(self._model.body_parentid[body])
        return weld or body

    def _joints(self, body: int) -> range:
        first = int(self._model.body_jntadr[body])
        return range(first, first + int(self._model.body_jntnum[body]))

    def _free(self, body: int) -> bool:
        return any(int(self._model.jnt_type[joint]) == _FREE for joint in self._joints(body))

    def _rigid(self, root: int) -> list[WorldBody]:
        """A body and those that are joined to it."""
        name, free = self._names[root], self._free(root)
        members = [body for body in range(1, self._model.nbody) if self._root(body) == root]
        if self._joints(root) and not free:
            self._notes.append(f"{name}: a joint holds it; it is taken as fixed where it is at the start")
        if inner := sum(len(self._joints(body)) for body in members if body != root):
            self._notes.append(f"{name}: {inner} joints on it are taken as rigid where they are at the start")
        links = [replace(self._link(body), fixed=not free) for body in members]
        return grouped(name, links, [(name, link.name) for link in links], self._notes)

    def _link(self, body: int) -> WorldLink:
        model = self._model
        geoms = range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
        found = [self._solid(geom) for geom in geoms]
        turn = _rotation(model.body_iquat[body])
        at_com = InertialParameters(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body]))
        inertial = at_com.in_frame(turn, np.array(model.body_ipos[body])) if model.body_mass[body] > 0 else None
        frame = self._data.body(body)
        pose = Pose(np.array(frame.xmat).reshape(3, 3), np.array(frame.xpos))
        return WorldLink(self._names[body], pose, tuple(each for each in found if each is not None), inertial)

    def _alone(self, geom: int) -> WorldBody | None:
        """A geom of the worldbody, as a body that does not move."""
        solid = self._solid(geom)
        return None if solid is None else WorldBody(self._geom_name(geom), Pose.identity(), (solid,), fixed=True)

    def _geom_name(self, geom: int) -> str:
        return str(self._model.geom(geom).name or f"world geom {geom}")

    def _solid(self, geom: int) -> WorldSolid | None:
        """A geom in the frame of its body; None for one that touches nothing, or has no solid."""
        model = self._model
        if not self._touches(geom):
            return None
        pose = Pose(_rotation(model.geom_quat[geom]), np.array(model.geom_pos[geom]))
        kind = _KINDS.get(int(model.geom_type[geom]), "")
        if kind == "plane":
            pose = pose @ solids.below_plane()
        shape = self._mesh(geom) if kind == "mesh" else _primitive(kind, np.array(model.geom_size[geom]))
        if shape is None:
            self._notes.append(f"{self._geom_name(geom)}: a height field or a signed distance is not read; left out")
            return None
        return WorldSolid(shape, pose, float(model.geom_friction[geom][0]))

    def _mesh(self, geom: int) -> Mesh:
        model, number = self._model, int(self._model.geom_dataid[geom])
        first, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
        begin, triangles = model.mesh_faceadr[number], model.mesh_facenum[number]
        vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
        faces = np.array(model.mesh_face[begin : begin + triangles], dtype=np.int64)
        try:
            whole = check_mesh(vertices, faces, name=model.mesh(number).name)
        except InputError as error:
            whole = check_mesh(*_hull(vertices, error), name=model.mesh(number).name)
            self._notes.append(f"{error.message}; its convex hull is taken, which MuJoCo lets touch")
            return Mesh(whole.vertices, whole.triangles, notes=whole.notes)
        mesh = Mesh(whole.vertices, whole.triangles, notes=whole.notes)
        if not mesh.polyhedron.convex:
            self._notes.append(f"{model.mesh(number).name}: read as it is; MuJoCo lets its convex hull touch")
        return mesh


def _hull(vertices: Array, error: InputError) -> tuple[Array, Array]:
    """Of the vertices of a mesh that is no solid; the error about the mesh where they have none."""
    try:
        hull = trimesh.convex.convex_hull(vertices)
    except QhullError:
        raise error from None
    return np.asarray(hull.vertices), np.asarray(hull.faces, dtype=np.int64)


def _pair_friction(assembly: Assembly, pair: FrictionPair) -> str:
    """The attributes of a pair: friction along two tangents, of spinning, and of rolling about both."""
    items = [assembly.objects[assembly.index[name]] for name in pair.objects]
    (spin, roll), dimensions = mjcf_resistance(items, assembly.rolling_between(*pair.objects), pair.coefficient)
    return f'friction="{pair.coefficient!r} {pair.coefficient!r} {spin!r} {roll!r} {roll!r}" condim="{dimensions}"'


_KINDS = {0: "plane", 2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}
"""mjtGeom."""


def _primitive(kind: str, size: Array) -> Shape | None:
    if kind == "plane":
        return solids.plane()
    if kind == "sphere":
        return solids.sphere(size[0])
    if kind == "capsule":
        return solids.capsule(size[0], 2 * size[1])
    if kind == "ellipsoid":
        return solids.ellipsoid(size)
    if kind == "cylinder":
        return solids.cylinder(size[0], 2 * size[1])
    return solids.box(2 * size) if kind == "box" else None


def _rotation(wxyz: Array) -> Array:
    return rotation_of_quaternion(np.roll(np.asarray(wxyz), -1))

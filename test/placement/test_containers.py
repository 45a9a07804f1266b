"""The container that is packed: found among fixed bodies, along its walls, on a pallet; height maps."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.placement import totes
from benchmarks.placement.scenes import box, of_cells
from poise.assembly import Assembly, Mesh, RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose, rotation_about
from poise.placement import Options, PackingOptions
from poise.placement.packing import encloses, find_container, heights_over, pack, rooms


def boxes(*sizes: tuple[float, float, float]) -> list[RigidObject]:
    return [box(f"box_{k}", size, (0, 0, 0)) for k, size in enumerate(sizes)]


def cubes(number: int, side: float = 0.1) -> list[RigidObject]:
    return boxes(*[(side,) * 3] * number)


def test_heights_of_many_small_triangles_are_those_of_the_flat_they_make():
    side = 60
    x, y = np.meshgrid(np.linspace(0, 1, side + 1), np.linspace(0, 1, side + 1), indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), (x + 2 * y).ravel()])
    number = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.vstack([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    surface = SimpleNamespace(triangles=triangles)
    heights = heights_over(surface, vertices, np.zeros(2), np.array([12, 10]), 0.1)
    middle = 0.05 + 0.1 * np.arange(10)
    assert heights[:10] == pytest.approx(middle[:, None] + 2 * middle, abs=1e-9)
    assert np.all(heights[10:] == -np.inf)


@pytest.mark.parametrize("own", [0.4, 0.0, -0.2])
def test_a_yawed_tote_of_one_mesh_is_packed_along_its_sides(own):
    """Also when the sides are oblique to the frame of the mesh."""
    cells = [(0, 0, 0, 8, 8, 1), (0, 0, 1, 1, 8, 4), (7, 0, 1, 8, 8, 4), (1, 0, 1, 7, 1, 4), (1, 7, 1, 7, 8, 4)]
    z = np.array([0.0, 0.0, 1.0])
    yaw, frame, mesh = rotation_about(z, 0.4), rotation_about(z, own), of_cells(tuple(cells))
    turned_mesh = Mesh(mesh.vertices @ (frame.T @ yaw).T, mesh.triangles)
    tote = RigidObject("tote", turned_mesh, Pose(frame, np.array([0.3, 0.1, 0.0])), fixed=True)
    floor = totes.tote().objects[0]
    found = pack(Assembly((floor, tote), friction=0.5), cubes(4, 0.07), Options())
    assert found.container.names == ("tote",)
    assert found.container.high - found.container.low == pytest.approx([0.15, 0.15], abs=1e-6)
    assert found.top == pytest.approx(0.07)
    turned = yaw.T @ found.placements[0].pose.rotation
    assert sorted(np.abs(turned).ravel()) == pytest.approx([0] * 6 + [1] * 3, abs=1e-6)


@pytest.mark.parametrize("side", [1.8, 3.0])
@pytest.mark.parametrize("bottom", [True, False])
def test_a_tote_on_a_turned_table_is_packed_along_its_walls(side, bottom):
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), np.radians(30))
    table = box("table", (side, side, 0.1), (0, 0, -0.05))
    parts = [item for item in totes.tote((0.4, 0.3, 0.2)).objects[1:] if bottom or item.id != "bottom"]
    move = np.array([0.6, 0.3, 0.0 if bottom else -0.01])
    bodies = [
        RigidObject("table", table.shape, Pose(turn, turn @ table.pose.translation), fixed=True),
        *(
            RigidObject(part.id, part.shape, Pose(np.eye(3), part.pose.translation + move), fixed=True)
            for part in parts
        ),
    ]
    found = find_container(Assembly(tuple(bodies), friction=0.5), None, None)
    assert np.sort(found.high - found.low) == pytest.approx([0.3, 0.4], abs=1e-6)
    middle = found.axes.T @ [*(found.low + found.high) / 2, 0.0]
    assert middle[:2] == pytest.approx([0.6, 0.3], abs=1e-6)
    assert {"left", "right", "front", "back"} <= set(found.names)


def test_pillars_enclose_nothing_and_are_not_searched_one_by_one(monkeypatch):
    searched = []
    search = rooms._heights
    monkeypatch.setattr(rooms, "_heights", lambda *given: searched.append(given) or search(*given))
    floor = totes.tote().objects[0]
    pillars = [box(f"pillar_{k}", (0.05, 0.05, 0.3), (0.2 * (k % 4), 0.2 * (k // 4), 0.15)) for k in range(16)]
    fixed = [RigidObject(item.id, item.shape, item.pose, fixed=True) for item in pillars]
    assert not encloses(Assembly((floor, *fixed), friction=0.5))
    assert len(searched) == 2


def pallet() -> Assembly:
    bodies = totes.tote().objects[:1], box("pallet", (0.406, 0.304, 0.1), (0.5, 0.5, 0.05))
    return Assembly((*bodies[0], RigidObject("pallet", bodies[1].shape, bodies[1].pose, fixed=True)), friction=0.5)


def test_a_pallet_is_packed_on_its_top():
    found = pack(pallet(), cubes(12), Options(packing=PackingOptions(into="pallet")))
    assert found.top == pytest.approx(0.1)
    assert found.utilisation == pytest.approx(12e-3 / (0.406 * 0.304 * 0.1))
    assert found.filled is None


def test_a_tote_with_sloping_walls_holds_less_at_its_bottom():
    (x, y), draft, depth = (0.2, 0.15), 0.02, 0.2
    rings = [(x + 0.01, y + 0.01, 0.0), (x + 0.03, y + 0.03, depth), (x + draft, y + draft, depth), (x, y, 0.01)]
    corners = [(i * a / 2, j * b / 2, z) for a, b, z in rings for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    quads = [(r + k, r + (k + 1) % 4, r + 4 + (k + 1) % 4, r + 4 + k) for r in (0, 4, 8) for k in range(4)]
    quads += [(0, 3, 2, 1), (12, 13, 14, 15)]
    triangles = np.array([part for a, b, c, d in quads for part in ((a, b, c), (a, c, d))])
    tote = RigidObject("tote", Mesh(np.array(corners), triangles), Pose(np.eye(3), np.zeros(3)), fixed=True)
    found = pack(Assembly((tote,), friction=0.5), boxes((0.19, 0.14, 0.05), (0.195, 0.145, 0.02)), orders=5)
    assert len(found.placements) == 2
    assert found.container.volume(found.container.floor + 0.19) == pytest.approx(0.19 * 0.21 * 0.16, rel=0.1)


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (PackingOptions(into="nothing"), ErrorCode.OBJECT_UNKNOWN, "nothing"),
        (PackingOptions(into="crate"), ErrorCode.BAD_INPUT, "not fixed"),
        (PackingOptions(), ErrorCode.OBJECT_INVALID, "into"),
    ],
)
def test_a_container_that_is_none_is_refused(options, code, says):
    scene = pallet().with_object(box("crate", (0.1, 0.1, 0.1), (0, 0, 0.05)))
    with pytest.raises(InputError, match=says) as error:
        find_container(scene, options.into, options.height)
    assert error.value.code is code


def test_two_totes_are_not_chosen_from():
    moved = [
        RigidObject(
            f"{item.id}_2", item.shape, Pose(np.eye(3), item.pose.translation + np.array([0.6, 0, 0])), fixed=True
        )
        for item in totes.tote().objects[1:]
    ]
    scene = Assembly((*totes.tote().objects, *moved), friction=0.5)
    with pytest.raises(InputError, match="name the body"):
        find_container(scene, None, None)
    assert find_container(scene, "bottom_2", None).low == pytest.approx([0.4, -0.15])


def test_two_totes_with_thin_walls_are_not_chosen_from():
    """On a floor so large that only the grid over each tote sees its walls."""
    floor = box("floor", (20.0, 20.0, 0.1), (0, 0, -0.05))
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), 0.5)
    bodies = [RigidObject("floor", floor.shape, floor.pose, fixed=True)]
    for name, x in (("a", 0.0), ("b", 2.0)):
        for part in totes.tote((0.3, 0.2, 0.2)).objects[1:]:
            pose = Pose(turn, turn @ part.pose.translation + np.array([x, 0.0, 0.0]))
            bodies.append(RigidObject(f"{part.id}_{name}", part.shape, pose, fixed=True))
    with pytest.raises(InputError, match="name the body"):
        find_container(Assembly(tuple(bodies), friction=0.5), None, None)
    single = Assembly(tuple(body for body in bodies if not body.id.endswith("_b")), friction=0.5)
    found = find_container(single, None, None)
    assert found.high - found.low == pytest.approx([0.3, 0.2], abs=1e-6)

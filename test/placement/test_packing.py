"""Packing: closed forms, limits of the container, an order that can be followed, causes of refusals, bounded time."""

import json
import sys
from collections import Counter
from collections.abc import Iterable
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.placement import packing as benchmark
from benchmarks.placement import totes
from benchmarks.placement.heightmaps import RIVALS, pack_on_heightmap
from benchmarks.placement.scenes import box
from poise.assembly import Analysis, Mesh, RigidObject
from poise.assembly.scene.scene_files import read_object
from poise.assembly.statics import NO_DEADLINE
from poise.cli import run as poise
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose, rotation_about
from poise.placement import CancelledError, Options, PackingOptions, Upright, plan_placement, plan_sequence
from poise.placement.packing import Packing, find_container, pack, turns, turns_of
from poise.placement.packing.arranging import Rule, drawn_orders
from poise.worlds import save_scene

TOUCHING = PackingOptions(gap=0.0)


def boxes(*sizes: tuple[float, float, float]) -> list[RigidObject]:
    return [box(f"box_{k}", size, (0, 0, 0)) for k, size in enumerate(sizes)]


def cubes(number: int, side: float = 0.1) -> list[RigidObject]:
    return boxes(*[(side,) * 3] * number)


def in_tote(
    inside: tuple[float, float, float], items: Iterable[RigidObject], options: PackingOptions = TOUCHING, **more
) -> Packing:
    return pack(totes.tote(inside), list(items), Options(packing=options), **more)


def test_eight_cubes_fill_a_tote_of_two_by_two_by_two():
    found = in_tote((0.2, 0.2, 0.2), cubes(8))
    assert found.top == pytest.approx(0.2)
    assert found.utilisation == pytest.approx(1.0)
    assert found.filled == pytest.approx(1.0)
    assert all(step.analysis.stability().margin >= found.margin - 1e-9 for step in found.placements)


def test_a_cut_block_goes_together_again():
    """A guillotine case: a plank of the whole floor, and three parts of the layer on it."""
    parts = boxes((0.15, 0.2, 0.1), (0.15, 0.1, 0.1), (0.1, 0.15, 0.1), (0.3, 0.2, 0.05))
    found = in_tote((0.3015, 0.2015, 0.15), parts, PackingOptions(gap=0.0005, height=0.15))
    assert found.filled == pytest.approx(0.3 * 0.2 / (0.3015 * 0.2015))


@pytest.mark.parametrize("gap", [0.002, 0.01])
def test_gaps_are_kept_and_everything_is_let_down_from_above(gap):
    found = in_tote((0.3, 0.2, 0.25), totes.objects("boxes", 5, 6), PackingOptions(gap=gap), orders=10)
    placed: list[np.ndarray] = []
    for one in found.placements:
        low, high = one.item.vertices.min(axis=0), one.item.vertices.max(axis=0)
        assert np.all(low[:2] >= np.array([-0.15, -0.1]) + gap - 1e-6)
        assert np.all(high[:2] <= np.array([0.15, 0.1]) - gap + 1e-6)
        for other_low, other_high in placed:
            apart = np.any((low[:2] >= other_high[:2] + gap - 1e-6) | (high[:2] <= other_low[:2] - gap + 1e-6))
            assert apart or low[2] >= other_high[2] - 1e-6
        placed.append((low, high))


def test_the_benchmark_runs_a_slice_and_is_not_above_deepest_bottom_left(tmp_path, monkeypatch):
    pytest.importorskip("mujoco")
    target, chosen = tmp_path / "packing.json", ["--packer", "poise", "--packer", "deepest-bottom-left-fill"]
    monkeypatch.setattr(sys, "argv", ["packing", "--quick", "--workers", "1", "--out", str(target), *chosen])
    benchmark.main()
    rows = json.loads(target.read_text())
    height = {(row["world"], row["packer"]): row["height"] for row in rows}
    for row in rows:
        if row["packer"] == "poise":
            assert row["packed"] == row["wanted"] == row["steps"]
            assert row["height"] <= height[row["world"], "deepest-bottom-left-fill"] + 1e-6


def test_the_seed_decides():
    first, second = (in_tote((0.4, 0.3, 0.25), totes.objects("boxes", 3, 7), seed=2, orders=12) for _ in range(2))
    assert [one.pose.vector.tolist() for one in first.placements] == [
        one.pose.vector.tolist() for one in second.placements
    ]


@pytest.mark.parametrize(
    ("items", "height", "cause"),
    [
        (boxes((0.3, 0.3, 0.3), (0.05, 0.05, 0.05)), None, "too_large"),
        (boxes((0.15, 0.18, 0.16)), 0.1, "under_lid"),
        (cubes(9), 0.2, "no_room"),
        (cubes(5), 0.1, "no_room"),
    ],
)
def test_the_cause_of_each_refusal_is_in_the_data_and_in_the_sentence(items, height, cause):
    with pytest.raises(NoAnswerError) as error:
        in_tote((0.2, 0.2, 0.2), items, PackingOptions(gap=0.0, height=height), orders=3)
    assert error.value.code is ErrorCode.NO_PLACEMENT
    assert error.value.data["cause"] == cause
    assert set(error.value.data["refused"].values()) == {cause}
    assert error.value.data["left"][0] in error.value.message


def test_a_can_that_may_not_stand_would_roll():
    can = read_object({"id": "can", "cylinder": [0.03, 0.1], "mass": 0.3})
    with pytest.raises(NoAnswerError, match="roll") as error:
        pack(totes.tote(), [can], Options(looks=[("turned", Upright(("x",)))]))
    assert error.value.data["refused"] == {"can": "would_roll"}
    assert "nothing was packed, since 1 of" in str(error.value)


@pytest.mark.parametrize(
    ("entry", "axes", "cause"),
    [
        ({"box": [0.1, 0.08, 0.05]}, ("x",), None),
        ({"box": [0.1, 0.08, 0.05], "up": 45}, ("x",), "orientation"),
        ({"cylinder": [0.03, 0.1]}, ("x",), "would_roll"),
        ({"sphere": 0.04}, (), "would_roll"),
        ({"box": [0.1, 0.08, 0.05], "com": [0.0499, 0, 0]}, ("z",), "would_tip"),
    ],
)
def test_causes_are_those_of_a_single_placement(entry, axes, cause):
    turned = rotation_about(np.array([0.0, 1.0, 0.0]), np.radians(entry.pop("up", 0)))
    item = read_object({"id": "item", "mass": 0.3, **entry})
    if cause == "orientation":
        mesh = item.shape.polyhedron
        item = RigidObject("item", Mesh(mesh.vertices @ turned.T, mesh.triangles), item.pose, mass=0.3)
    options = Options(looks=[("turned", Upright(axes))])
    if cause is None:
        assert len(pack(totes.tote(), [item], options).placements) == 1
        return
    with pytest.raises(NoAnswerError) as error:
        pack(totes.tote(), [item], options)
    assert error.value.data["refused"] == {"item": cause}


def test_what_the_certificates_reject_has_their_cause():
    tests = [("leaves no room for the hand", lambda analysis, item: item.id != "box_1")]
    with pytest.raises(NoAnswerError, match="the hand") as error:
        pack(totes.tote(), cubes(3), Options(tests=tests, attempts=4), orders=2)
    assert error.value.data["refused"] == {"box_1": "no_room_for_hand"}
    assert error.value.data["left"] == ["box_1"]


def test_each_object_has_its_attempts():
    """The first object fails in each of its attempts; the second and the third need a few of their own."""
    asked: Counter[str] = Counter()

    def test(analysis, item):
        asked[item.id] += 1
        return item.id != "box_0" and asked[item.id] > 2

    sizes = ((0.12,) * 3, (0.1,) * 3, (0.08,) * 3)
    with pytest.raises(NoAnswerError) as error:
        pack(totes.tote(), boxes(*sizes), Options(tests=[("never", test)], attempts=3), orders=1)
    assert asked == {"box_0": 3, "box_1": 3, "box_2": 3}
    assert error.value.data["left"] == ["box_0"]


def ring(number: int, radius: float, height: float) -> Mesh:
    """A prism of many sides."""
    angle = 2 * np.pi * np.arange(number) / number
    round_ = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.vstack([np.column_stack([round_, np.full(number, z)]) for z in (0.0, height)])
    k = np.arange(number)
    after = (k + 1) % number
    sides = np.vstack([np.column_stack([k, after, number + after]), np.column_stack([k, number + after, number + k])])
    fan = np.column_stack([np.zeros(number - 2, int), k[1:-1], k[2:]])
    return Mesh(vertices, np.vstack([sides, fan[:, ::-1], fan + number]))


@pytest.mark.parametrize("sides", [12, 48])
def test_a_mesh_of_a_can_stands_on_its_ends(sides):
    can = RigidObject("can", ring(sides, 0.05, 0.05), Pose(np.eye(3), np.zeros(3)), mass=0.3)
    turns, _ = turns_of(can, 1e-3)
    assert turns
    assert all(abs(turned.pose.rotation[2, 2]) > 0.99 for turned in turns)


def test_a_fine_mesh_is_looked_at_within_the_deadline(monkeypatch):
    covered = []
    cover = turns.cover_of
    monkeypatch.setattr(turns, "cover_of", lambda *given: covered.append(given) or cover(*given))
    monkeypatch.setattr("poise.placement.packing.job.time", SimpleNamespace(monotonic=count().__next__))
    can = RigidObject("can", ring(48, 0.05, 0.05), Pose(np.eye(3), np.zeros(3)), mass=0.3)
    with pytest.raises(NoAnswerError) as error:
        pack(totes.tote(), [can], Options(deadline=3.0))
    assert error.value.code is ErrorCode.DEADLINE
    assert not covered


def test_a_full_tote_has_no_room():
    full = in_tote((0.2, 0.2, 0.1), boxes((0.2, 0.2, 0.1))).analysis
    with pytest.raises(NoAnswerError) as error:
        pack(full, [box("more", (0.05, 0.05, 0.05), (0, 0, 0))], Options(packing=PackingOptions(height=0.1)))
    assert error.value.data["cause"] == "no_room"


def test_what_is_in_the_tote_stays_where_it_is():
    half = in_tote((0.2, 0.1, 0.2), cubes(1)).analysis
    found = pack(half, [box("more", (0.1, 0.1, 0.1), (0, 0, 0))], Options(packing=TOUCHING))
    assert found.top == pytest.approx(0.1)
    assert found.utilisation == pytest.approx(1.0)
    assert found.filled == pytest.approx(0.5)


def test_what_was_in_the_tote_and_is_higher_is_the_top_of_the_load():
    half = in_tote((0.2, 0.1, 0.2), boxes((0.1, 0.1, 0.1))).analysis
    beside = box("beside", (0.1, 0.1, 0.1), (0.5, 0.5, 0.05))
    scene = half.with_object(beside)
    found = pack(scene, [box("more", (0.1, 0.1, 0.05), (0, 0, 0))], Options(packing=TOUCHING))
    assert found.top == pytest.approx(0.1)
    assert found.volume == pytest.approx(1.5e-3)
    assert found.utilisation == pytest.approx(0.75)


@pytest.mark.parametrize("axes", [("x",), ("-z", "y"), ("z",)])
def test_only_allowed_axes_point_up(axes):
    found = pack(totes.tote(), totes.objects("boxes", 1, 4), Options(looks=[("turned", Upright(axes))]), orders=3)
    for one in found.placements:
        up = one.pose.rotation.T @ [0, 0, 1]
        named = ("-" if up.sum() < 0 else "") + "xyz"[int(np.abs(up).argmax())]
        assert named in axes


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_lid_has_a_height(value):
    with pytest.raises(InputError):
        PackingOptions(height=value)


@pytest.mark.parametrize("deadline", [None, 1e-9, 20.0])
def test_every_request_ends_by_its_deadline(monkeypatch, deadline):
    """The clock of this test goes on by a second whenever it is read."""
    clock = count()
    monkeypatch.setattr("poise.placement.packing.job.time", SimpleNamespace(monotonic=lambda: float(next(clock))))
    with pytest.raises(NoAnswerError) as error:
        pack(totes.tote(), cubes(80, 0.03), Options(deadline=deadline))
    assert error.value.code is ErrorCode.DEADLINE
    assert next(clock) <= (60 if deadline is None else deadline) + 5


@pytest.mark.parametrize(
    "planner", [pack, plan_sequence, lambda scene, items, how: plan_placement(scene, items[0], how)]
)
def test_whether_the_scene_stands_is_asked_within_the_deadline(monkeypatch, planner):
    given, stability = [], Analysis.stability
    monkeypatch.setattr(
        Analysis, "stability", lambda scene, until=NO_DEADLINE: given.append(until) or stability(scene, until)
    )
    with pytest.raises(NoAnswerError) as error:
        planner(totes.tote(), cubes(2, 0.03), Options(deadline=1e-9))
    assert error.value.code in (ErrorCode.DEADLINE, ErrorCode.NO_PLACEMENT)
    assert given[0].passed


@pytest.mark.parametrize("steps", [1, 2, 4])
def test_the_search_for_the_container_ends_by_the_deadline(steps):
    """It asks before each of its steps, and ends with what that raises."""
    asked = count(1)

    def proceed():
        if next(asked) >= steps:
            raise TimeoutError

    with pytest.raises(TimeoutError):
        find_container(totes.tote(), None, None, proceed)
    assert next(asked) == steps + 1


def test_an_arrangement_that_is_certified_in_time_is_given():
    found = pack(totes.tote(), cubes(3), Options(deadline=30.0))
    assert len(found.placements) == 3


def test_packing_is_cancelled_by_its_caller():
    with pytest.raises(CancelledError):
        pack(totes.tote(), cubes(3), progress=lambda _: False)


@pytest.fixture
def command(tmp_path, capsys):
    scene, target = tmp_path / "tote.yaml", tmp_path / "answer.json"
    save_scene(totes.tote((0.25, 0.2, 0.2)), scene)

    def call(*arguments: str) -> tuple[int, dict, str]:
        status = poise(["place", str(scene), *arguments, "--json", str(target)])
        printed = capsys.readouterr()
        return status, json.loads(target.read_text()) if target.exists() else {}, printed.out + printed.err

    return call


ITEMS = [word for k in range(3) for word in ("--object", f"{{id: b{k}, box: [0.1, 0.08, 0.05], mass: 0.{k + 1}}}")]


def test_the_command_packs_several_objects_into_a_tote(command):
    status, answer, printed = command(*ITEMS, "--orders", "5")
    assert status == 0
    assert answer["top"] == pytest.approx(0.05)
    assert answer["utilisation"] == pytest.approx(3 * 0.4e-3 / (0.25 * 0.2 * 0.05))
    assert answer["filled"] == pytest.approx(answer["utilisation"] / 4)
    assert answer["margin"] > 0
    assert answer["container"]["size"] == pytest.approx([0.25, 0.2])
    assert answer["container"]["depth"] == pytest.approx(0.2)
    assert "utilisation" in printed


def test_options_that_compare_placements_are_kept(command):
    status, answer, _ = command(*ITEMS[:4], "--criterion", "least", "--candidates", "1")
    assert status == 0
    assert len(answer["placements"]) == 2
    assert "container" not in answer


def test_an_entry_says_which_of_its_axes_may_point_up(command):
    standing = "{id: tall, box: [0.1, 0.08, 0.15], mass: 0.1, up: [z, -z]}"
    status, answer, _ = command(*ITEMS[:2], "--object", standing, "--orders", "3")
    assert status == 0
    assert answer["top"] == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("more", "status", "says"),
    [
        (["--height", "0.04"], 3, "does not fit under the lid"),
        (["--height", "-1"], 2, "positive height"),
        (["--gap", "-1"], 2, "gap"),
        (["--height", "0.1", "--planner", "poise"], 2, "--planner packing"),
        (["--into", "b0"], 2, "b0"),
        (["--criterion", "median", "--planner", "packing"], 2, "--criterion"),
        (["--refine", "--candidates", "3", "--height", "0.1"], 2, "--candidates, --refine"),
        (["--axes", "z,w"], 2, "'w'"),
        (["--axes", "z", "--upright"], 2, "one of them"),
        (["--object", "{id: x, box: [0.1, 0.1, 0.1], mass: 1, up: 3}"], 2, "up is 3"),
        (["--object", "{id: x, box: [0.4, 0.1, 0.4], mass: 1}"], 3, "larger than the container"),
    ],
)
def test_what_cannot_be_packed_is_said(command, more, status, says):
    found, answer, printed = command(*ITEMS, *more)
    assert found == status
    assert says in " ".join(printed.split())
    assert ("refused" in answer) == (status == 3)


def test_the_first_order_is_deepest_bottom_left_fill_itself():
    """Boxes as wide as cells of its heightmap, without gaps: the same places as the rival's."""
    sizes = [(0.12, 0.1, 0.08), (0.1, 0.08, 0.06), (0.08, 0.06, 0.06), (0.06, 0.06, 0.04)]
    items, inside = boxes(*sizes), (0.3, 0.2, 0.25)
    room = find_container(totes.tote(inside), None, None)
    rival = pack_on_heightmap(RIVALS[0], room, items)
    found = in_tote(inside, items, orders=1)
    heights = [float(item.vertices[:, 2].max()) - room.floor for item in rival]
    assert found.top <= max(heights) + 1e-6
    order = [placement.item.id for placement in found.placements]
    assert order == [item.id for item in rival]


def test_the_last_orders_are_changes_of_the_best():
    items, rng = totes.objects("boxes", 5, 6), np.random.default_rng(0)
    best = list(reversed(items)), Rule(1.0, 0.5)
    drawn = list(drawn_orders(items, 20, rng, lambda: best))
    assert len(drawn) == 20
    assert all(sorted(item.id for item in order) == sorted(item.id for item in items) for order, _ in drawn)
    last = [order for order, _ in drawn[-6:]]
    moved = [sum(a.id != b.id for a, b in zip(order, best[0], strict=True)) for order in last]
    assert min(moved) < 6
    assert all(rule == best[1] or order == best[0] for order, rule in drawn[-6:])

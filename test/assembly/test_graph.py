"""The contact interface graph and its blocks; adding and removing one object at a time."""

from dataclasses import replace

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import box, fixed_box

from poise.assembly import Analysis, Assembly, FrictionPair, Push, assess
from poise.assembly.contact.graph import FIXED_NODE, Structure
from poise.assembly.statics.changes import analysis_after
from poise.errors import ErrorCode, InputError


def members(structure):
    ids = [item.id for item in structure.assembly.objects]
    return [[{ids[place] for place in group} for group in block.members] for block in structure.blocks]


def test_a_stack_is_a_chain_of_blocks_of_one_body_each_with_all_that_rests_on_it():
    found = members(Structure.of(scenes.stack(3)))
    assert sorted(found, key=lambda block: len(block[0])) == [[{"c2"}], [{"c1", "c2"}], [{"c0", "c1", "c2"}]]


def test_a_slab_on_two_legs_is_one_block_because_the_floor_closes_a_cycle():
    found = members(Structure.of(scenes.table()))
    assert found == [[{"left"}, {"right"}, {"slab"}]]


def test_what_stands_on_a_slab_is_a_block_of_its_own_and_rides_on_the_slab():
    table = scenes.table().with_object(box("cup", (0.1, 0.1, 0.1), (0, 0, 1.25)))
    found = sorted(members(Structure.of(table)), key=len)
    assert found == [[[{"cup"}][0]], [{"left"}, {"right"}, {"slab", "cup"}]]


def test_fixed_bodies_are_one_node():
    pillars = [fixed_box(f"p{x}", (0.5, 1, 1), (x, 0, 0.5)) for x in (-1, 1)]
    structure = Structure.of(Assembly((*pillars, box("beam", (3, 1, 0.2), (0, 0, 1.1))), scenes.GRAVITY))
    assert list(structure.edges) == [(FIXED_NODE, 2)]
    assert len(structure.blocks[0].interfaces) == 2


@pytest.mark.parametrize("place", range(7))
def test_blocks_answer_what_the_whole_assembly_does(place):
    """Two stacks on a shared slab on two legs: solved in blocks, or as one problem that knows no blocks."""
    from poise.assembly.contact.graph import ContactBlock
    from poise.assembly.statics.analysis import BlockAnalysis
    from poise.assembly.statics.block_solvers import BlockSolvers
    from poise.assembly.statics.pushes import loads_of

    assembly = scenes.table()
    for side in (-0.5, 0.5):
        for level in range(2):
            assembly = assembly.with_object(box(f"s{side}{level}", (0.3, 0.3, 0.3), (side, 0, 1.35 + 0.3 * level)))
    structure = Structure.of(assembly)
    item = assembly.objects[structure.movable[place]]
    half = np.array(item.shape.size) / 2
    rng = np.random.default_rng(place)
    whole = ContactBlock(
        tuple((index,) for index in structure.movable),
        tuple(range(len(structure.interfaces))),
        tuple(
            tuple(FIXED_NODE if assembly.objects[i].fixed else structure.movable.index(i) for i in (n.first, n.second))
            for n in structure.interfaces
        ),
    )
    together = BlockAnalysis(structure, whole, BlockSolvers(structure, whole))
    for _ in range(5):
        point = item.pose.translation + half * [-1, *rng.uniform(-1, 1, 2)]
        push = Push(item.id, point, (1, *rng.normal(0, 0.3, 2)))
        blocks = assess(Analysis(structure), [push], "limit").results[0].robustness
        _, loads = together.loads(loads_of(assembly, [push], 1e-3))
        assert blocks == pytest.approx(1 / together.solvers.limit.inverse_factor(loads[0]).value, rel=1e-6)


def test_adding_and_removing_objects_one_by_one_gives_what_a_new_start_gives():
    final = scenes.table().with_object(box("cup", (0.1, 0.1, 0.1), (0.3, 0.2, 1.25)))
    grown = Analysis.of(Assembly(final.objects[:1], final.gravity, final.friction))
    for item in (*final.objects[1:3], final.objects[3], final.objects[4]):
        grown = grown.with_object(item)
    grown = grown.with_object(box("extra", (0.1, 0.1, 0.1), (3, 0, 0.05))).without("extra")
    pushes = [Push("slab", (1, 0.1, 1.1), (-1, 0, 0)), Push("cup", (0.25, 0.2, 1.25), (1, 0, 0))]
    for a, b in zip(assess(grown, pushes).results, assess(final, pushes).results, strict=True):
        assert a.robustness == pytest.approx(b.robustness, rel=1e-6)


def test_blocks_that_a_new_object_does_not_touch_keep_their_solvers():
    before = Analysis.of(scenes.on_floor(box("a", (1, 1, 1), (0, 0, 0.5)), box("b", (1, 1, 1), (3, 0, 0.5))))
    kept = {id(block.solvers): block.solvers.limit for block in before.blocks}
    after = before.with_object(box("c", (1, 1, 1), (3, 0, 1.5)))
    shared = [block.solvers for block in after.blocks if id(block.solvers) in kept]
    assert len(shared) == 1
    assert shared[0].limit is kept[id(shared[0])]


def test_moving_an_object_away_from_its_support_is_refused():
    with pytest.raises(InputError) as caught:
        Analysis.of(scenes.stack(2)).with_object(box("c1", (1, 1, 1), (5, 0, 1.5)))
    assert caught.value.code is ErrorCode.FLOATING


def test_an_analysis_starts_from_what_another_assembly_has_in_common():
    before = Analysis.of(scenes.stack(4))
    again = analysis_after(before, scenes.stack(4))
    assert again is before
    after = analysis_after(before, scenes.stack(3).with_object(box("top", (1, 1, 1), (0.1, 0, 3.5), 2.0)))
    fresh = Analysis.of(after.assembly)
    assert {item.id for item in after.assembly.objects} == {"floor", "c0", "c1", "c2", "top"}
    assert after.stability().margin == pytest.approx(fresh.stability().margin)
    # The interface between floor and lowest cube has not been looked for again.
    assert {id(i.points) for i in before.structure.interfaces} & {id(i.points) for i in after.structure.interfaces}
    assert (
        not analysis_after(before, scenes.stack(3).with_object(box("c0", (1, 1, 1), (0, 0.7, 0.5)))).stability().stable
    )
    other = analysis_after(before, scenes.stack(4, friction=0.2))
    assert other.structure.interfaces[0].friction == 0.2
    with pytest.raises(InputError) as raised:
        analysis_after(before, scenes.stack(4).without("c1"))
    assert raised.value.code == ErrorCode.FLOATING


def test_another_assembly_on_another_floor_is_taken_over():
    """Nothing fixed is common to both: what is new cannot be built upon the old."""
    cube = box("cube", (1, 1, 1), (0, 0, 0.5))
    before, after = (Assembly((fixed_box(name, (4, 4, 1), (0, 0, -0.5)), cube)) for name in ("a", "b"))
    assert analysis_after(Analysis.of(before), after).assembly.index == {"b": 0, "cube": 1}


def test_blocks_that_stay_share_their_solvers_and_keep_their_own_places():
    first = Analysis.of(scenes.stack(3))
    aside = box("aside", (0.2, 0.2, 0.2), (5, 0, 0.1))
    floor, *boxes = first.assembly.objects
    # Other places in `Assembly.objects` for the same blocks.
    other = Analysis.of(Assembly((floor, aside), first.assembly.gravity, first.assembly.friction))
    grown = other.with_object(*boxes).without("aside")
    later = grown.with_object(aside)
    solvers = {id(block.solvers) for block in grown.blocks}
    assert len(solvers) == 3
    assert solvers < {id(block.solvers) for block in later.blocks}
    for analysis in (grown, later):
        for block in analysis.blocks:
            places = [place for members in block.block.members for place in members]
            assert list(block.body_of) == places
            assert all({interface.first, interface.second} & set(places) for interface in block.interfaces)


def test_the_analysis_follows_changed_pairs_and_rolling():
    before = Analysis.of(scenes.stack(2))
    objects = before.assembly.objects
    rough = replace(before.assembly, friction_pairs=(FrictionPair((objects[0].id, objects[1].id), 0.9),))
    assert [each.friction for each in analysis_after(before, rough).structure.interfaces] == [
        each.friction for each in Analysis.of(rough).structure.interfaces
    ]
    again = analysis_after(analysis_after(before, rough), before.assembly)  # the pair is left out
    assert {each.friction for each in again.structure.interfaces} == {before.assembly.friction}
    rolling = replace(before.assembly, rolling=0.1)
    assert analysis_after(before, rolling).assembly.rolling == 0.1

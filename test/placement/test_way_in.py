"""Placements that an arm can reach: nothing is placed where no straight way leads, whatever way a rack is turned."""

import numpy as np
import pytest

from poise.assembly import Analysis, Assembly, Box, RigidObject, plan_disassembly
from poise.errors import NoAnswerError
from poise.geometry import Pose, rotation_of_vector
from poise.placement import Options, Validator, cause_of, plan_placement, refusals
from poise.placement.packing import REFUSALS

_ITEM = RigidObject("item", Box((0.1, 0.1, 0.1)), Pose.identity(), mass=0.3)
_WALLS = {
    "bottom": ((0.3, 0.3, 0.01), (0, 0, -0.005)),
    "left": ((0.01, 0.3, 0.2), (-0.155, 0, 0.1)),
    "right": ((0.01, 0.3, 0.2), (0.155, 0, 0.1)),
    "back": ((0.3, 0.01, 0.2), (0, 0.155, 0.1)),
    "front": ((0.3, 0.01, 0.2), (0, -0.155, 0.1)),
    "lid": ((0.32, 0.32, 0.01), (0, 0, 0.205)),
}


def _cage(without: tuple[str, ...] = (), turned: float = 0.0, width: float = 0.3) -> Assembly:
    """Fixed walls around a room 0.3 m deep and 0.2 m high, turned about the vertical, degrees."""
    turn = Pose(rotation_of_vector(np.array([0, 0, np.radians(turned)])), np.zeros(3))
    walls = []
    for name, (size, middle) in _WALLS.items():
        across = middle[0] * (width + 0.01) / 0.31
        place = turn @ Pose(np.eye(3), np.array([across, *middle[1:]], dtype=float))
        walls.append(RigidObject(name, Box(size), place, fixed=True))
    return Assembly(tuple(wall for wall in walls if wall.id not in without))


@pytest.mark.parametrize("without", [(), ("lid",), ("front",), ("left", "lid")])
def test_a_closed_box_takes_nothing(without: tuple[str, ...]) -> None:
    """It stands inside, and is turned away unless a wall or the lid is missing."""
    validator = Validator(Analysis.of(_cage(without)), _ITEM, settling=False)
    found = validator.accept(Pose(np.eye(3), np.array([0.0, 0.0, 0.05])))
    assert (found is not None) == bool(without)
    assert validator.rejected["no straight way leads there"] == (not without)


@pytest.mark.parametrize("degrees", [0.0, 20.0, 67.0])
def test_a_turned_rack_takes_what_fits_between_its_sides(degrees: float) -> None:
    """4 mm of room on each side: only the line along the compartment leads in, and out again."""
    rack = _cage(("front",), degrees, width=0.108)
    turn = rotation_of_vector(np.array([0, 0, np.radians(degrees)]))
    found = Validator(Analysis.of(rack), _ITEM, settling=False).accept(Pose(turn, np.array([0.0, 0.0, 0.05])))
    assert found is not None
    way = plan_disassembly(found[0]).ways[0]
    assert way is not None
    np.testing.assert_allclose(way, turn @ [0, -1, 0], atol=1e-9)


def test_the_cause_is_said() -> None:
    """Nothing may be above the box, so that only the room inside it would hold the object."""
    below = ("is above the box", lambda item: bool(item.vertices[:, 2].max() < 0.2))
    with pytest.raises(NoAnswerError, match="no straight way leads there") as error:
        plan_placement(_cage(), _ITEM, Options(attempts=60, looks=(below,)))
    assert error.value.data["cause"] == "no_way_in"


def test_packing_has_a_sentence_for_each_cause() -> None:
    """Of the tests of a pose, and of those that planners and arms add."""
    causes = {*refusals._STAGES.values(), *refusals._NAMED.values(), cause_of({"a condition of a user": 1})}
    assert causes <= set(REFUSALS)

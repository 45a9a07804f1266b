"""The order of the loop against a robot of plain Python: what is skipped, tried again, and ends the loop."""

import numpy as np
import pytest

from poise.errors import ErrorCode, NoAnswerError
from poise.nodes.loop_results import loop_content
from poise.nodes.loop_sequence import Carried, LoopOverError, LoopSequence, NodeEndedError, WeighedObject

NAMES = ["object", "object_2", "object_3"]
WEIGHT = WeighedObject(0.5, np.array([0.0, 0.0, 0.1]), np.diag([1e-6, 1e-8, 1e-8, 1e-8]), 0.501, np.array([0, 0, 0.1]))


class Robot:
    """Does every step, but for the ones in `wrong`: (step, object) -> errors, one for each attempt.

    After a NodeEndedError in `late`, the step had been done.
    """

    def __init__(self, wrong=None, late=(), lifted=()):
        self.wrong, self.late, self.lifted = {key: list(errors) for key, errors in (wrong or {}).items()}, late, lifted
        self.hand, self.tray, self.calls, self.recovered = "", [], [], 0

    def _fail(self, step, name):
        self.calls.append((step, name))
        errors = self.wrong.get((step, name), [])
        return errors.pop(0) if errors else None

    def scan(self, count):
        if error := self._fail("scan", ""):
            raise error
        return NAMES[:count]

    def pick(self, name, seed):
        error = self._fail("pick", name)
        if error is None or ("pick", name) in self.late or name in self.lifted:
            self.hand = name
        if error:
            raise error

    def weigh(self, attempt):
        if error := self._fail("weigh", self.hand):
            raise error
        return WEIGHT

    def place(self, seed):
        error = self._fail("place", self.hand)
        if error is None or ("place", self.hand) in self.late:
            self.tray = [each for each in self.tray if each != self.hand] + [self.hand]
            self.hand = ""
        if error:
            raise error
        return 2.0

    def held(self):
        return self.hand

    def standing(self, name):
        return name in self.tray

    def carry(self, distance, left_behind):
        self.left_behind = left_behind
        if error := self._fail("carry", ""):
            raise error
        return Carried(distance, 4.0, 0.8, 2.5, 1e-4)

    def recover(self):
        self.recovered += 1


def run(robot, count=3):
    return LoopSequence(robot, count, 3.0).run()


def failure(code=ErrorCode.UNREACHABLE):
    return NoAnswerError(code, "not possible")


def test_what_the_first_scan_did_not_show_is_looked_for_again():
    robot = Robot()
    shown = iter([NAMES[1:], NAMES])
    robot.scan = lambda count: next(shown)
    record = run(robot)
    assert [each.name for each in record.placed] == ["object_2", "object_3", "object"]
    assert record.whole
    robot = Robot()
    scans = iter([NAMES[:2], NAMES[:2]])  # two objects, where three are wanted
    robot.scan = lambda count: next(scans)
    record = run(robot)
    assert [each.outcome for each in record.objects] == ["placed", "placed"]
    assert record.carried is not None
    assert not record.whole


def test_a_loop_in_which_all_goes_well():
    robot = Robot()
    record = run(robot)
    assert record.whole
    assert robot.tray == NAMES
    assert [step.step for step in record.steps] == ["scan", *3 * ["pick", "weigh", "place"], "carry"]
    content = loop_content(record, 1.0, {"world_model": 0}, 2.0)
    assert (content["complete"], content["error"], content["restarts"]) == (True, None, {})
    assert content["objects"][0]["mass_error"] == pytest.approx(-0.002, rel=0.01)
    assert content["objects"][0]["within"]


def test_a_loop_that_is_not_asked_to_carry_is_whole_without():
    robot = Robot()
    assert LoopSequence(robot, 3, 0.0).run().whole
    assert ("carry", "") not in robot.calls


def test_an_object_that_cannot_be_grasped_is_skipped_and_left_behind():
    robot = Robot({("pick", "object_2"): [failure(ErrorCode.TOO_HEAVY)]})
    record = run(robot)
    assert [known.outcome for known in record.objects] == ["placed", "skipped", "placed"]
    assert record.objects[1].why == "not possible"
    assert robot.left_behind == ["object_2"]
    assert (record.error, record.whole) == (None, False)


def test_weighing_and_placing_are_tried_again():
    robot = Robot({("weigh", "object"): [failure()], ("place", "object_3"): [failure(), failure()]})
    assert run(robot).whole
    assert robot.calls.count(("weigh", "object")) == 2
    assert robot.calls.count(("place", "object_3")) == 3
    assert robot.recovered == 3


def test_an_object_that_cannot_be_weighed_is_placed_and_the_loop_is_not_whole():
    record = run(Robot({("weigh", "object"): 3 * [failure()]}))
    assert (record.objects[0].outcome, record.objects[0].weight, record.whole) == ("placed", None, False)


def test_what_cannot_be_placed_ends_the_loop_in_the_hand():
    record = run(Robot({("place", "object_2"): 3 * [failure(ErrorCode.NO_PLACEMENT)]}))
    assert record.error is not None
    assert record.error.code is ErrorCode.NO_PLACEMENT
    assert [known.outcome for known in record.objects] == ["placed", "held"]
    assert record.carried is None


def test_a_placement_that_was_done_before_its_node_ended_is_not_done_twice():
    robot = Robot({("place", "object"): [NodeEndedError("a_node")]}, late=[("place", "object")])
    assert run(robot).whole
    assert robot.calls.count(("place", "object")) == 1


def test_what_an_interrupted_pick_holds_is_put_down_and_picked_again_before_it_is_weighed():
    robot = Robot({("pick", "object"): [NodeEndedError("a_node")]}, late=[("pick", "object")])
    assert run(robot).whole
    done = [step for step, name in robot.calls if name == "object"]
    assert done == ["pick", "place", "pick", "weigh", "place"]


def test_what_fell_from_the_hand_is_looked_for_at_the_end_and_taken_again():
    robot = Robot({("place", "object"): [failure(ErrorCode.NOT_HELD)]})
    record = run(robot)
    assert record.whole
    assert robot.calls.count(("scan", "")) == 2
    assert robot.calls[-4:-1] == [("pick", "object"), ("weigh", "object"), ("place", "object")]
    assert [(each.name, each.outcome) for each in record.objects][-1] == ("object", "placed")


def test_what_fell_and_is_not_found_may_lie_on_the_tray_so_nothing_is_carried():
    robot = Robot({("place", "object"): [failure(ErrorCode.NOT_HELD)], ("scan", ""): [None, failure(ErrorCode.EMPTY)]})
    record = run(robot)
    assert (record.error.code, record.carried) == (ErrorCode.NOT_HELD, None)
    assert [each.outcome for each in record.objects] == ["lost", "placed", "placed"]


def test_a_pick_that_is_interrupted_again_and_again_ends_the_loop():
    robot = Robot({("pick", "object"): 2 * [failure()]}, lifted=["object"])
    record = run(robot)
    assert record.error is not None
    assert record.error.code is ErrorCode.NOT_HELD
    assert ("weigh", "object") not in robot.calls


@pytest.mark.parametrize("step", ["scan", "pick", "weigh", "place", "carry"])
def test_a_step_whose_node_ended_is_begun_again(step):
    name = "" if step in ("scan", "carry") else "object_2"
    robot = Robot({(step, name): [NodeEndedError("a_node")]})
    assert run(robot).whole
    assert robot.calls.count((step, name)) == 2


def test_what_is_stopped_is_not_tried_again():
    robot = Robot({("weigh", "object"): [failure(ErrorCode.CANCELLED)]})
    record = run(robot)
    assert record.error is not None
    assert record.error.code is ErrorCode.CANCELLED
    assert robot.calls[-1] == ("weigh", "object")


@pytest.mark.parametrize("step", ["pick", "weigh", "place"])
def test_a_loop_ends_at_once_without_its_robot(step):
    robot = Robot({(step, "object"): [LoopOverError(ErrorCode.TOPIC_MISSING, "fake_robot has ended")]})
    record = run(robot)
    assert record.error is not None
    assert record.error.message == "fake_robot has ended"
    assert (robot.calls[-1], robot.recovered) == ((step, "object"), 0)


def test_a_loop_whose_robot_does_not_come_to_rest_goes_to_no_other_object():
    class Restless(Robot):
        def recover(self):
            raise failure(ErrorCode.DEADLINE)

    robot = Restless({("pick", "object"): [NodeEndedError("a_node")]})
    record = run(robot)
    assert isinstance(record.error, LoopOverError)
    assert record.error.code is ErrorCode.DEADLINE
    assert robot.calls[-1] == ("pick", "object")


def test_an_object_that_left_the_hand_unseen_ends_the_loop_as_not_placed():
    class Dropping(Robot):
        def weigh(self, attempt):
            self.hand = ""
            raise failure(ErrorCode.NOT_HELD)

    record = run(Dropping())
    assert record.objects[0].outcome == "lost"
    assert not record.whole


def test_with_nothing_on_the_tray_nothing_is_carried():
    robot = Robot({("pick", name): [failure()] for name in NAMES})
    record = run(robot)
    assert record.error is not None
    assert record.error.code is ErrorCode.EMPTY
    assert ("carry", "") not in robot.calls

"""The nodes as the loop uses them, without ROS: what is not fresh, not filled in or not known is not taken for good."""

import time
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped

from poise.errors import ErrorCode, InputError, NoAnswerError, PoiseError
from poise.fake_robots import loop_job
from poise.nodes import loop_robot
from poise.nodes.loop_bag import LoopBag
from poise.nodes.loop_robot import NodesRobot
from poise.nodes.loop_sequence import NodeEndedError
from poise_msgs.action import CarryObject, PickObject

VALUES = {"world": "", "shapes": "scan", "ready_timeout": 60.0, "planning": 1.0, "riding": [], "speed": 0.5}


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> NodesRobot:
    monkeypatch.setattr(loop_robot, "EventsExecutor", MagicMock())
    monkeypatch.setattr(loop_robot, "ActionClient", MagicMock())
    monkeypatch.setattr(loop_robot, "_LOOK", -1.0)  # at each turn of a wait
    return NodesRobot(MagicMock(), VALUES)


def test_processes_are_looked_after_in_every_wait_but_that_of_a_cancel(robot: NodesRobot) -> None:
    looks: list[int] = []
    robot._check = lambda: looks.append(1) or []  # type: ignore[func-returns-value]
    robot.wait(lambda: len(looks) > 1, 60.0, "two looks")  # such as that for news of a world_model that has ended
    turns = iter([False, False, True])
    robot.wait(lambda: next(turns), 60.0, "the end of a goal", heed=False)
    assert len(looks) == 2


def test_an_arm_that_is_not_heard_does_not_rest(robot: NodesRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop_robot, "_STOPPING", 0.0)
    monkeypatch.setattr(robot, "ready", lambda seconds: None)
    robot._joints = (0.0, np.zeros(7))  # it has not moved for long when it was heard last
    with pytest.raises(NoAnswerError, match="rest of the arm"):
        robot.recover()


def test_a_goal_that_its_node_ended_without_a_result_has_not_succeeded(robot: NodesRobot) -> None:
    handle, sent, answer = MagicMock(accepted=True), MagicMock(), MagicMock()
    sent.result.return_value, handle.get_result_async.return_value = handle, answer
    answer.result.return_value = SimpleNamespace(status=6, result=PickObject.Result())
    robot._clients["pick_object"].send_goal_async.return_value = sent
    with pytest.raises(NoAnswerError, match="status 6"):
        robot._do("pick_object")


def test_what_moved_on_the_tray_counts_from_the_first_attempt(
    robot: NodesRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = iter([{"a": np.zeros(3)}, {"a": np.array([0.0, 0.0, 0.2])}])
    monkeypatch.setattr(robot, "_truth", SimpleNamespace(places=lambda frame, without: next(places)))
    monkeypatch.setattr(robot, "wait", lambda *_, **__: None)
    robot._goal, answers = PoseStamped(), iter([NoAnswerError(ErrorCode.DEADLINE, "late"), CarryObject.Result()])

    def do(name: str, **fields: object) -> CarryObject.Result:
        if isinstance(answer := next(answers), PoiseError):
            raise answer
        return answer

    monkeypatch.setattr(robot, "_do", do)
    with pytest.raises(NoAnswerError):
        robot.carry(1.0, [])
    assert robot.carry(1.0, []).moved == pytest.approx(0.2)


def test_topics_of_unknown_types_are_left_out_of_the_bag() -> None:
    node, writer = MagicMock(), MagicMock()
    node.get_topic_names_and_types.return_value = [
        ("/strange", ["foreign_msgs/msg/Thing"]),
        ("/joint_states", ["sensor_msgs/msg/JointState"]),
    ]
    LoopBag(node, writer).look()
    assert [call.args[0] for call in writer.add_topic.call_args_list] == ["/joint_states"]
    assert "/strange" in node.get_logger().warning.call_args.args[0]


def test_a_parameter_file_without_the_loop_is_refused(tmp_path) -> None:
    config = tmp_path / "mine.yaml"
    config.write_text("/**:\n  fake_robot:\n    ros__parameters: {}\n")
    job = loop_job.LoopJob(str(config), 1, 0, None, 0.0, "given", None)
    with pytest.raises(InputError, match="no parameters of the node loop") as error:
        loop_job._values(job, config, tmp_path)
    assert error.value.code is ErrorCode.BAD_INPUT


def test_a_node_that_was_killed_has_ended_although_its_watchdog_still_answers(
    robot: NodesRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop_robot, "_LOOK", 0.02)
    monkeypatch.setattr(loop_robot, "node_seconds", lambda: 7.0)  # the simulated clock waits for the node
    said = PickObject.Result()
    said.error.code = int(ErrorCode.INTERNAL)
    handle, sent, answer = MagicMock(accepted=True), MagicMock(), MagicMock()
    sent.result.return_value, handle.get_result_async.return_value = handle, answer
    answer.result.return_value = SimpleNamespace(status=6, result=said)
    robot._clients["pick_object"].send_goal_async.return_value = sent
    looks = iter([[], [], ["object_picker"]])
    robot._check = lambda: time.sleep(0.1) or next(looks)  # a busy machine: each look takes longer than it may wait
    with pytest.raises(NodeEndedError):
        robot._do("pick_object")
    robot._check = lambda: []
    with pytest.raises(NoAnswerError) as error:
        robot._do("pick_object")
    assert error.value.code is ErrorCode.INTERNAL


def test_a_node_that_computes_has_the_time_of_the_machine_too(
    robot: NodesRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A simulated clock that runs ahead while a node plans does not end the wait for its answer."""
    begun = time.monotonic()
    monkeypatch.setattr(loop_robot, "node_seconds", lambda: 1000.0 * (time.monotonic() - begun))
    robot.wait(lambda: time.monotonic() > begun + 0.2, 0.5, "an answer")
    with pytest.raises(NoAnswerError, match="within 0 s"):
        robot.wait(lambda: False, 0.1, "an answer")

"""Changes of the assembly that come while others are computed: no answer is about another assembly than it says."""

import math
import time
from functools import partial
from types import SimpleNamespace

import pytest
import rclpy
from assembly_calls import CUBE, FRAME, LID, LOW_PUSH, assess, box, change, message, replace_by
from geometry_msgs.msg import TransformStamped
from rclpy.serialization import deserialize_message, serialize_message
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from poise.errors import ErrorCode, InputError, PoiseError
from poise.nodes.jobs import Job
from poise.nodes.robustness_calls import SHORT_OBJECTS, call_of
from poise.nodes.robustness_server import RobustnessServer
from poise.nodes.robustness_worker import RobustnessWorker
from poise.nodes.transforms import add_transforms
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness, SetAssembly

pytestmark = pytest.mark.ros
G, MU = 9.80665, 0.5


class HereWorker:
    """A worker in this process; `then` runs once, when an exchange of a kind was answered."""

    def __init__(self):
        self.state, self.starts, self.then, self.meanwhile = {}, 1, {}, None
        self.answering = RobustnessWorker([], 0)

    def start(self, due):
        if self.meanwhile is not None:
            self.meanwhile, meanwhile = None, self.meanwhile
            meanwhile()

    def ask(self, header, messages, due):
        answer = self.answering(header, messages)
        self.then.pop(header["do"], lambda: None)()
        return answer

    def stop(self):
        pass


@pytest.fixture
def server(domain, monkeypatch):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(domain_id=domain)
    node = RobustnessServer(SimpleNamespace(close=lambda: None))
    node._workers = [HereWorker(), HereWorker()]
    yield node
    node.destroy_node()
    rclpy.shutdown()


def answered(server, kind, request, worker=0, claimed=True):
    """The answer of one worker; not claimed: after its caller was answered by the clock."""
    service = {"assess": AssessRobustness, "set": SetAssembly}[kind]
    call = call_of(kind, request, server._frames, server._present.frame, server._limits, 30.0)
    job = Job(service, time.monotonic() + 30.0)
    if not claimed:
        job.refuse(ErrorCode.DEADLINE, "too late", by_clock=True)
    return server._answer(call, job, worker)


def refuse_a_message(server):
    bad = message(CUBE)
    bad.objects[1].pose.position.z = math.nan
    server._on_assembly(bad)


def limit(server, worker=0):
    answer = answered(server, "assess", assess(LOW_PUSH), worker)
    return answer.robustness[0].robustness, answer.version


def test_a_change_is_refused_when_a_bad_message_came_while_it_was_computed(server):
    answered(server, "set", replace_by(message(CUBE)))
    server._workers[0].then["set"] = partial(refuse_a_message, server)
    with pytest.raises(InputError, match="version 2 by now"):
        answered(server, "set", replace_by(message(CUBE, LID)))
    with pytest.raises(PoiseError):
        limit(server)
    answered(server, "set", replace_by(message(CUBE, LID)))
    for worker in (0, 1):
        assert limit(server, worker) == (pytest.approx(3 * MU * G), 3)


def test_a_proposal_that_was_not_claimed_is_never_set(server):
    answered(server, "set", replace_by(message(CUBE, LID)), claimed=False)
    assert answered(server, "set", replace_by(message(CUBE)), worker=1).version == 1
    for _ in range(2):  # the first call makes the worker hold what was set, the second one uses that
        assert limit(server) == (pytest.approx(MU * G), 1)


def test_an_answer_is_about_one_assembly_in_one_frame(server):
    answered(server, "set", replace_by(message(CUBE)))
    other = message(CUBE, LID)
    other.header.frame_id = "other"
    server._workers[0].meanwhile = lambda: answered(server, "set", replace_by(other), worker=1)
    assert limit(server) == (pytest.approx(MU * G), 1)
    assert (server._present.frame, server._present.version) == ("other", 2)
    server._workers[0].meanwhile = lambda: answered(server, "set", replace_by(message(CUBE)), worker=1)
    lid = AssemblyMessage(objects=message(LID).objects[1:])
    with pytest.raises(InputError, match="version 3 by now"):  # also what is to be changed
        answered(server, "set", change(SetAssembly.Request.REMOVE, lid))


def test_what_was_set_and_cannot_be_held_can_be_replaced(server):
    answered(server, "set", replace_by(message(CUBE)))
    server._present = server._present._replace(serialized=b"no message")
    with pytest.raises(PoiseError):
        limit(server, worker=1)
    answered(server, "set", replace_by(message(CUBE, LID)), worker=1)
    assert limit(server) == (pytest.approx(3 * MU * G), 2)


def test_a_worker_answers_about_no_assembly_that_it_does_not_have():
    worker = RobustnessWorker([], 0)
    header = {"do": "assess", "key": 3, "deadline": time.monotonic() + 30.0}
    _, (answer,) = worker(header, [serialize_message(assess(LOW_PUSH))])
    assert deserialize_message(answer, AssessRobustness.Response).error.code == ErrorCode.INTERNAL


@pytest.mark.parametrize("messages", [[b"no message"], [serialize_message(message(box("cube", (1, 1, 1), (0, 0, 9))))]])
def test_what_cannot_be_held_or_drawn_is_an_error_with_its_reason(messages):
    worker = RobustnessWorker([], 0)
    answer, _ = worker({"do": "hold", "key": 1, "deadline": math.inf}, messages)
    code, reason = answer["error"]
    assert (code in (ErrorCode.INTERNAL, ErrorCode.FLOATING), bool(reason)) == (True, True)
    answer, (drawn,) = worker({"do": "draw", "key": 1, "frame": FRAME, "map": True}, [])
    assert answer["error"][0] == ErrorCode.INTERNAL
    assert not deserialize_message(drawn, MarkerArray).markers


def test_one_move_by_tf_waits_at_a_time_and_large_ones_are_heavy(server):
    boxes = [box(f"b{i}", (1, 1, 1), (2.0 * i, 0, 0.5)) for i in range(5)]
    answered(server, "set", replace_by(message(*boxes)))
    added = []
    server._jobs.add = lambda task, seconds: not added.append(task)
    moved = TransformStamped(child_frame_id="b0")
    moved.header.frame_id = FRAME
    moved.transform.translation.z, moved.transform.translation.x = 0.5, -1.0
    add_transforms(server._frames, TFMessage(transforms=[moved]))
    for _ in range(3):
        server._follow_tf()
    assert [task.heavy for task in added] == [False]
    added.pop().work(Job(None, time.monotonic() + 30.0), 0)
    assert server._present.version == 2
    boxes += [box(f"c{i}", (1, 1, 1), (2.0 * i, 5, 0.5)) for i in range(SHORT_OBJECTS)]
    server._present = server._present._replace(message=message(*boxes))
    server._follow_tf()
    assert [task.heavy for task in added] == [True]


def test_the_map_of_the_markers_waits_among_the_heavy_calls_and_is_asked_for_once(server):
    server._values["marker_map_points"] = 20
    for worker in server._workers:
        worker.answering = RobustnessWorker([], 20)
    answered(server, "set", replace_by(message(CUBE)))
    added = []
    server._jobs.add = lambda task, seconds: not added.append(task)
    for _ in range(3):
        server._draw_soon()
    assert [task.heavy for task in added] == [False, True]
    layers = []
    for thread, task in enumerate(added):
        task.work(Job(None, time.monotonic() + 30.0), thread)
        layers.append(set(server._layers))
    assert layers[1] - layers[0] == {"map"}


def test_a_large_assembly_that_waited_longer_does_not_replace_the_newer_small_one(server):
    waiting = []
    server._jobs.add = lambda task, seconds: not waiting.append(task.work)
    server._on_assembly(message(CUBE, LID))
    server._on_assembly(message(CUBE))
    for work in reversed(waiting):  # the large one waits among the heavy calls
        work(Job(None, time.monotonic() + 10.0), 0)
    assert [item.id for item in server._present.message.objects] == ["floor", "cube"]


def test_a_follower_that_missed_an_assembly_does_not_answer_for_the_one_before(server):
    server._follow = True
    server._on_assembly(message(CUBE))
    deadline = time.monotonic() + 10.0
    while server._present.message is None and time.monotonic() < deadline:
        time.sleep(0.01)
    server._jobs.add = lambda task, seconds: False
    server._on_assembly(message(CUBE, LID))
    assert server._present.problem.code == ErrorCode.BUSY
    assert server._present.message is None

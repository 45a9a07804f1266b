"""robustness_server on poses from tf that have errors: answered, and refused only when nothing explains them."""

import numpy as np
import pytest
from assembly_calls import CUBE, FRAME, LATCHED, LID, LOW_PUSH, assess, message, replace_by
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from poise.errors import ErrorCode
from poise.geometry import Pose, rotation_of_vector
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness, SetAssembly

pytestmark = pytest.mark.ros
G, MU = 9.80665, 0.5
PARAMETERS = {
    "poses_from_tf": True,
    "tf_rate": 50.0,
    "pose_std_position": 0.002,
    "pose_std_rotation_deg": 0.5,
    "samples": 4,
}


def ask(graph, request):
    kinds = {AssessRobustness: "assess_robustness", SetAssembly: "set_assembly"}
    kind = next(kind for kind in kinds if isinstance(request, kind.Request))
    return graph.call(kind, kinds[kind], request)


def tf_of(item, shift, turn=(0.0, 0.0, 0.0)):
    """The frame of an object that is seen with an error: m and rad."""
    pose = Pose(rotation_of_vector(np.asarray(turn)) @ item.pose.rotation, item.pose.translation + shift)
    stamped = TransformStamped(child_frame_id=item.id)
    stamped.header.frame_id = FRAME
    place, rotation = stamped.transform.translation, stamped.transform.rotation
    place.x, place.y, place.z, rotation.x, rotation.y, rotation.z, rotation.w = pose.vector.tolist()
    return stamped


def test_noisy_poses_from_tf_are_answered_and_what_nothing_explains_is_refused(start_node, graph):
    assemblies = graph.collect("assembly", AssemblyMessage, LATCHED)
    start_node("robustness_server", PARAMETERS)
    assert ask(graph, replace_by(message(CUBE, LID))).stable
    moving = graph.node.create_publisher(TFMessage, "tf", 10)
    graph.wait_for(moving.get_subscription_count, what="the server at tf")
    rng = np.random.default_rng(3)
    for _ in range(5):
        before = len(assemblies)
        errors = [(0.002 * rng.normal(size=3), 0.008 * rng.normal(size=3)) for _ in (CUBE, LID)]
        frames = [tf_of(item, *error) for item, error in zip((CUBE, LID), errors, strict=True)]
        moving.publish(TFMessage(transforms=frames))
        graph.wait_for(lambda before=before: len(assemblies) > before, what="the settled poses")
        answer = ask(graph, assess(LOW_PUSH))
        assert answer.error.code == ErrorCode.OK
        (result,) = answer.robustness
        assert result.robustness == pytest.approx(3 * MU * G, rel=2e-3)  # cube and lid slide together
        assert result.interval_lower <= result.robustness <= result.interval_upper
        assert any("2 poses settled" in each for each in answer.assumptions)
        assert any("over 4 draws" in each for each in answer.assumptions)
        cube, lid = assemblies[-1].objects[1:]
        assert (cube.pose.position.z, lid.pose.position.z) == pytest.approx((0.5, 1.1), abs=3e-4)
    moving.publish(TFMessage(transforms=[tf_of(LID, [0, 0, 0.3])]))
    graph.wait_for(lambda: ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.FLOATING, what="FLOATING")
    moving.publish(TFMessage(transforms=[tf_of(LID, [0.001, 0, 0.002])]))
    graph.wait_for(lambda: ask(graph, assess(LOW_PUSH)).error.code == ErrorCode.OK, what="the lid to be back")

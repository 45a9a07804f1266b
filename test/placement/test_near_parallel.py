"""Two planes that are nearly parallel: the object comes between them, not to where they meet, kilometres away."""

import numpy as np

from poise.placement.matching import SupportPoint, _on_planes


def test_planes_that_meet_kilometres_away_do_not_send_the_object_there() -> None:
    tilted = np.array([1e-5, 0.0, 1.0]) / np.hypot(1.0, 1e-5)
    low, high = SupportPoint(np.zeros(3), np.array([0.0, 0.0, 1.0])), SupportPoint(np.array([0.1, 0, 0.1]), tilted)
    foot, com = np.array([0.0, 0.0, -0.05]), np.zeros(3)
    pose = _on_planes(np.eye(3), [(low, foot), (high, foot)], np.array([0.05, 0.0, 0.05]), com)
    assert np.abs(pose.translation).max() < 1.0


def test_planes_at_an_angle_are_both_touched() -> None:
    wall, floor = SupportPoint(np.zeros(3), np.array([1.0, 0, 0])), SupportPoint(np.zeros(3), np.array([0, 0.1, 1.0]))
    points = np.array([[-0.05, 0.0, 0.0], [0.0, 0.0, -0.05]])
    pose = _on_planes(np.eye(3), [(wall, points[0]), (floor, points[1])], np.ones(3), np.zeros(3))
    assert abs(wall.normal @ pose.apply(points[0])) < 1e-12
    assert abs(floor.normal @ pose.apply(points[1])) < 1e-12

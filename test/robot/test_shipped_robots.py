"""The robots that come with Poise against the makers' tables."""

import numpy as np
import pinocchio as pin
import pytest

from poise.robot import RobotModel, frame_poses
from poise.robot.model import MODELS

ROBOTS = sorted(path.stem for path in MODELS.glob("*.urdf"))
MILLI = 1e-3


def translation(x, y, z):
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def rotation(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    pose = np.eye(4)
    i, j = {"x": (1, 2), "z": (0, 1)}[axis]
    pose[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return pose


def denavit_hartenberg(q, table):
    """Denavit and Hartenberg's own convention: Rz(q) Tz(d) Tx(a) Rx(alpha)."""
    pose = np.eye(4)
    for angle, (d, a, alpha) in zip(q, table, strict=True):
        pose = pose @ rotation("z", angle) @ translation(a, 0, d) @ rotation("x", np.radians(alpha))
    return pose


def craig(q, table):
    """Craig's convention: Rx(alpha) Tx(a) Rz(q) Tz(d)."""
    pose = np.eye(4)
    for angle, (a, d, alpha) in zip(q, table, strict=True):
        pose = (
            pose @ rotation("x", np.radians(alpha)) @ translation(a, 0, 0) @ rotation("z", angle) @ translation(0, 0, d)
        )
    return pose


# The makers' tables, in mm and degrees.
FR3 = [(0, 333, 0), (0, 0, -90), (0, 316, 90), (82.5, 0, 90), (-82.5, 384, -90), (0, 0, 90), (88, 0, 90)]
XARM7 = [(267, 0, -90), (0, 0, 90), (293, 52.5, 90), (0, 77.5, 90), (342.5, 0, 90), (0, 76, -90), (97, 0, 0)]
UR10 = [(127.3, 0, 90), (0, -612, 0), (0, -572.3, 0), (163.941, 0, 90), (115.7, 0, -90), (92.2, 0, 0)]
UR5E = [(162.5, 0, 90), (0, -425, 0), (0, -392.2, 0), (133.3, 0, 90), (99.7, 0, -90), (99.6, 0, 0)]
UR10E = [(180.7, 0, 90), (0, -612.7, 0), (0, -571.55, 0), (174.15, 0, 90), (119.85, 0, -90), (116.55, 0, 0)]


def scaled(table, lengths):
    return [tuple(value * MILLI if i in lengths else value for i, value in enumerate(row)) for row in table]


@pytest.mark.parametrize("seed", range(5))
def test_fr3_stands_where_frankas_table_puts_it(seed):
    q = np.random.default_rng(seed).uniform(-2, 2, 7)
    expected = craig(q, scaled(FR3, (0, 1))) @ translation(0, 0, 0.107 + 0.0254)
    check("fr3", q, expected)


@pytest.mark.parametrize("seed", range(5))
def test_xarm7_stands_where_ufactorys_table_puts_it(seed):
    q = np.random.default_rng(seed).uniform(-2, 2, 7)
    check("xarm7", q, denavit_hartenberg(q, scaled(XARM7, (0, 1))) @ translation(0, 0, 0.0375))


@pytest.mark.parametrize("seed", range(5))
def test_ur10_stands_where_universal_robots_table_puts_it_on_the_base(seed):
    q = np.random.default_rng(seed).uniform(-2, 2, 9)
    base = translation(q[0], q[1], 0) @ rotation("z", q[2]) @ translation(0, 0, 0.28)
    check("ridgeback_ur10", q, base @ denavit_hartenberg(q[3:], scaled(UR10, (0, 1))) @ translation(0, 0, 0.0375))


@pytest.mark.parametrize(("name", "table"), [("ur5e", UR5E), ("ur10e", UR10E)])
def test_e_series_stands_where_universal_robots_table_puts_it(name, table):
    q = np.random.default_rng(0).uniform(-2, 2, 6)
    check(name, q, denavit_hartenberg(q, scaled(table, (0, 1))) @ translation(0, 0, 0.0375))


def check(name, q, expected):
    matrix, place = frame_poses(RobotModel.from_file(name), q)
    np.testing.assert_allclose(matrix[0], expected[:3, :3], atol=1e-9)
    np.testing.assert_allclose(place[0], expected[:3, 3], atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_body_could_exist(name):
    """Positive mass, principal moments positive and no larger than the sum of the other two."""
    for inertia in RobotModel.from_file(name).pinocchio.inertias[1:]:
        if inertia.mass > 0:
            moments = np.linalg.eigvalsh(inertia.inertia)
            assert moments[0] > 0
            assert moments[2] <= moments[0] + moments[1]


@pytest.mark.parametrize("name", ROBOTS)
def test_limits_frames_and_gripper(name):
    model = RobotModel.from_file(name)
    assert (model.lower < model.upper).all()
    assert (model.velocity_limit > 0).all()
    assert (model.effort_limit > 0).all()
    for frame in ("base_link", "ft_sensor", "tcp"):
        model.frame_id(frame)
    sensor, tcp = (frame_poses(model, np.zeros(len(model.joint_names)), frame)[1] for frame in ("ft_sensor", "tcp"))
    assert np.linalg.norm(tcp - sensor) == pytest.approx(0.163)
    load = model.load_in_sensor
    assert load[0] == pytest.approx(0.905)
    assert load[3] / load[0] == pytest.approx(0.058)


@pytest.mark.parametrize(("name", "mass"), [("fr3", 17.9 + 0.36 + 0.905), ("ridgeback_ur10", 195.0 + 28.9)])
def test_total_mass_is_the_data_sheets(name, mass):
    """FR3 about 17.9 kg by its inertials (17.8 in the data sheet); UR10 28.9 kg on a Ridgeback of 195 kg."""
    model = RobotModel.from_file(name, base="floating")
    assert pin.computeTotalMass(model.pinocchio) == pytest.approx(mass, rel=0.03)

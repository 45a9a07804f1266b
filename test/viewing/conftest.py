"""Identifications to draw, made once."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from swinging_payload import START, identify_motion, swing

from poise.inertia.pipeline.estimate import Identification
from poise.robot import SensorMotion


@pytest.fixture(scope="session")
def identification() -> Identification:
    return identify_motion(swing(600))


@pytest.fixture(scope="session")
def static_identification() -> Identification:
    """Twenty-four poses held still: the inertia cannot show."""
    rotations = Rotation.random(24, rng=np.random.default_rng(5)).as_matrix()
    return identify_motion(SensorMotion.at_rest(START + np.arange(24) * 10**9, rotations))

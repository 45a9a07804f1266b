"""Weighted least squares on poses held still."""

from poise.inertia.estimators.entry import EstimatorEntry, MotionNeed
from poise.inertia.estimators.least_squares_stream import LeastSquaresStream

ENTRY = EstimatorEntry(
    "static",
    "weighted least squares on poses held still",
    estimate=None,
    stream=LeastSquaresStream,
    motion=MotionNeed.STILL,
    gives_covariance=True,
    uses_imu=False,
)

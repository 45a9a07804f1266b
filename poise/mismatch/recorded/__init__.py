"""One recording in the form that effects use: measured and predicted wrench, motion, and the wrench of a rigid load."""

from poise.mismatch.recorded.channels import WRENCH_CHANNELS, directed
from poise.mismatch.recorded.joint_torques import efforts_alone, joint_torques, shown, wrench_of_torques
from poise.mismatch.recorded.link_track import LINK_PARAMETERS, LinkTrack
from poise.mismatch.recorded.load_wrench import forces_at, load_wrench, motion_response
from poise.mismatch.recorded.noise_levels import (
    NoiseLevel,
    block_means,
    coarse_steps,
    lattice,
    noise_level,
    rounding,
    white_level,
    wrench_rounding,
)
from poise.mismatch.recorded.recorded_motion import (
    AT_REST,
    BaseTrack,
    CommandTrack,
    EffortTrack,
    JointTrack,
    RecordedMotion,
    moving,
)
from poise.mismatch.recorded.resampling import at_times, hermite, linear_at, smoothing

__all__ = [
    "AT_REST",
    "LINK_PARAMETERS",
    "WRENCH_CHANNELS",
    "BaseTrack",
    "CommandTrack",
    "EffortTrack",
    "JointTrack",
    "LinkTrack",
    "NoiseLevel",
    "RecordedMotion",
    "at_times",
    "block_means",
    "coarse_steps",
    "directed",
    "efforts_alone",
    "forces_at",
    "hermite",
    "joint_torques",
    "lattice",
    "linear_at",
    "load_wrench",
    "motion_response",
    "moving",
    "noise_level",
    "rounding",
    "shown",
    "smoothing",
    "white_level",
    "wrench_of_torques",
    "wrench_rounding",
]

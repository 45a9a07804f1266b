"""One recording in the form that effects use: measured and predicted wrench, motion, and the wrench of a rigid load."""

from poise.mismatch.recorded.channels import WRENCH_CHANNELS, directed
from poise.mismatch.recorded.load_wrench import forces_at, load_wrench, motion_response
from poise.mismatch.recorded.noise_levels import NoiseLevel, block_means, lattice, noise_level, white_level
from poise.mismatch.recorded.recorded_motion import BaseTrack, EffortTrack, JointTrack, RecordedMotion
from poise.mismatch.recorded.resampling import at_times

__all__ = [
    "WRENCH_CHANNELS",
    "BaseTrack",
    "EffortTrack",
    "JointTrack",
    "NoiseLevel",
    "RecordedMotion",
    "at_times",
    "block_means",
    "directed",
    "forces_at",
    "lattice",
    "load_wrench",
    "motion_response",
    "noise_level",
    "white_level",
]

"""Use of a model with effects: simulate a motion, compensate a recording, state the known load, values to export."""

from poise.mismatch.application.compensation import CompensatedWrench, compensate
from poise.mismatch.application.found_drives import found_drives
from poise.mismatch.application.free_run_check import Worsening, worsening
from poise.mismatch.application.free_run_input import recorded_run
from poise.mismatch.application.known_load import loads_about
from poise.mismatch.application.model_values import found_payload, found_sensor, joint_values, without_place
from poise.mismatch.application.simulated_run import SimulatedRun, run_planned, run_recorded
from poise.mismatch.application.unsure_values import UnsureValue, unsure_values

__all__ = [
    "CompensatedWrench",
    "SimulatedRun",
    "UnsureValue",
    "Worsening",
    "compensate",
    "found_drives",
    "found_payload",
    "found_sensor",
    "joint_values",
    "loads_about",
    "recorded_run",
    "run_planned",
    "run_recorded",
    "unsure_values",
    "without_place",
    "worsening",
]

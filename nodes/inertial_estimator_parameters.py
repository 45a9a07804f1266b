"""The parameters of inertial_estimator: what they mean, their ranges, and the options that they make."""

from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.files import package_file
from poise.inertia.estimators import method_choices
from poise.inertia.model import NoiseLevels, load_object
from poise.inertia.pipeline import IMUS, SOURCES, LiveOptions
from poise.nodes.parameters import Parameter
from poise.robot import PairingSettings

_SETTINGS = ("max_gap", "rest_gap", "rest_window", "rest_turning", "rest_speed", "block", "margin")
NOISE = ("force", "torque", "linear_acceleration", "angular_acceleration")
BIAS = ("force_bias", "torque_bias")

PARAMETERS = (
    Parameter("sensor_frame", "", "frame of the wrench; empty: that of its first message"),
    Parameter("base_frame", "", "gravity-aligned frame in tf; empty: the root of the tree"),
    Parameter(
        "motion_source",
        "auto",
        "joint_states, tf, or auto: joint_states if a robot_description arrives, otherwise tf",
        SOURCES,
    ),
    Parameter(
        "imu",
        "auto",
        "linear acceleration from an IMU that tf_static connects to the sensor: never; always, as on a moving base;"
        " auto: where tf has attitudes only",
        IMUS,
    ),
    Parameter("gravity", 9.80665, "gravity, m/s2", (0.1, 100.0)),
    Parameter(
        "method",
        "poise",
        "estimator; poise: uses all information; static: poses at rest; ols: motion; auto: static or ols, by motion;"
        " the others keep samples, see window",
        method_choices(),
    ),
    Parameter(
        "window", 0.0, "s of samples that are kept, for rtls, geo, pmd and hps; 0: all since the start", (0.0, 600.0)
    ),
    Parameter("publish_rate", 10.0, "largest rate of inertial_estimate while samples arrive, Hz", (0.1, 100.0)),
    Parameter("continuous", True, "method poise only: report a change of the payload, and start again after it"),
    Parameter("object", "", "path of a mesh or cloud of the payload, as for poise identify --object; empty: unknown"),
    Parameter("object_scale", 1.0, "m per unit of that file", (1e-9, 1e9)),
    Parameter(
        "object_pose", [0.0] * 6 + [1.0], "pose of that file's frame in the sensor frame: x y z m, quaternion x y z w"
    ),
    Parameter("noise_force", 0.0, "N, one sigma of a sample; 0: estimated from the samples", (0.0, 1e3)),
    Parameter("noise_torque", 0.0, "N m, one sigma of a sample; 0: estimated from the samples", (0.0, 1e3)),
    Parameter(
        "noise_linear_acceleration", 0.0, "m/s2, one sigma of the motion's acceleration; 0: estimated", (0.0, 1e3)
    ),
    Parameter(
        "noise_angular_acceleration", 0.0, "rad/s2, one sigma of the motion's acceleration; 0: estimated", (0.0, 1e3)
    ),
    Parameter(
        "noise_force_bias", -1.0, "N, expected bias, one sigma; 0: the sensor was zeroed; -1: unknown", (-1.0, 1e6)
    ),
    Parameter(
        "noise_torque_bias", -1.0, "N m, expected bias, one sigma; 0: the sensor was zeroed; -1: unknown", (-1.0, 1e6)
    ),
    Parameter("max_force", 0.0, "N at which an axis of the sensor is saturated; 0: no limit", (0.0, 1e6)),
    Parameter("max_torque", 0.0, "N m at which an axis of the sensor is saturated; 0: no limit", (0.0, 1e6)),
    Parameter("max_gap", 0.2, "s between kinematic samples above which they are not interpolated", (0.001, 10.0)),
    Parameter("rest_gap", 1.0, "s, the same for attitudes at rest", (0.001, 60.0)),
    Parameter("rest_window", 0.1, "s before and after a sample in which the sensor must be at rest", (0.01, 10.0)),
    Parameter("rest_turning", 0.02, "rad/s below which it is at rest", (0.0, 10.0)),
    Parameter("rest_speed", 0.01, "m/s below which it is at rest", (0.0, 10.0)),
    Parameter("block", 0.5, "s of motion that are differentiated in one block", (0.1, 10.0)),
    Parameter(
        "margin",
        0.5,
        "s of motion on either side of a block that its spline includes; block and margin delay the estimate",
        (0.1, 10.0),
    ),
    Parameter(
        "flush_after",
        0.5,
        "s without any message after which samples no longer wait for later motion; more if messages come in bursts",
        (0.1, 60.0),
    ),
    Parameter("best_effort", False, "take wrenches by best effort, even from a reliable publisher (some may be lost)"),
)


def _noise(values: dict[str, Any]) -> NoiseLevels:
    """The levels that are given; NaN for those that are estimated from the samples."""
    levels = {name: values[f"noise_{name}"] or np.nan for name in NOISE}
    biases = {name: values[f"noise_{name}"] for name in BIAS}
    return NoiseLevels(**levels, **{name: np.nan if value < 0 else value for name, value in biases.items()})


def live_options(values: dict[str, Any]) -> LiveOptions:
    """What the parameters ask for.

    Raises:
        InputError: what `load_object` raises, BAD_INPUT when the object has no pose.
    """
    shape = {}
    if values["object"]:
        pose = values["object_pose"]
        if len(pose) != 7:
            raise InputError(
                ErrorCode.BAD_INPUT, f"parameter object_pose is {pose}: give x y z and a quaternion x y z w"
            )
        given = load_object(package_file(values["object"]), values["object_scale"]).placed(pose[:3], pose[3:])
        shape = {"parts": given.parts, "accuracy": given.accuracy}
    return LiveOptions(
        sensor_frame=values["sensor_frame"],
        base_frame=values["base_frame"],
        motion_source=values["motion_source"],
        imu=values["imu"],
        gravity=values["gravity"],
        method=values["method"],
        noise=_noise(values),
        window=values["window"] or np.inf,
        continuous=values["continuous"],
        saturation=(values["max_force"] or np.inf, values["max_torque"] or np.inf),
        **shape,
        settings=PairingSettings(**{name: values[name] for name in _SETTINGS}),
        flush_after=values["flush_after"],
    )

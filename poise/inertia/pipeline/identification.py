"""From a recording to what the sensor carried: chooses the kinematics, pairs them with the wrenches, and weighs."""

import functools
import math
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes import NOT_FINITE
from poise.inertia.estimators import (
    AUTO,
    LEAST_SQUARES,
    OLS,
    OWN_METHOD,
    InformationAccumulator,
    joined,
    method_names,
    model_matrix,
    solve,
)
from poise.inertia.model import Parts, RejectedInterval
from poise.inertia.pipeline.estimate import Identification, InertialEstimate
from poise.inertia.pipeline.method_pipeline import PairedSamples
from poise.inertia.pipeline.offline import weigh
from poise.inertia.pipeline.online import MAX_GRAVITY, OnlineEstimator
from poise.inertia.pipeline.samples import collect
from poise.recording import Recording, WrenchStream
from poise.robot import (
    USED,
    Imu,
    ImuSource,
    Kinematics,
    PairingSettings,
    RobotModel,
    find_imu,
    find_kinematics,
    has_topic,
)
from poise.types import Array, Progress, Stamps

__all__ = [
    "METHODS",
    "Identification",
    "InertialEstimate",
    "Kinematics",
    "RejectedInterval",
    "find_kinematics",
    "identify",
    "identify_wrenches",
]

METHODS = (OWN_METHOD, *LEAST_SQUARES, *(name for name in method_names() if name not in (OWN_METHOD, OLS)))
"""The default first."""

HISTORY = 50
"""How many points show the estimate closing in."""

CHUNKS = 20
"""A recording is fed in this many pieces, so that its kinematics do not have to be remembered all at once."""


def identify(
    recording: Recording,
    *,
    robot_model: RobotModel | None = None,
    sensor_frame: str | None = None,
    base_frame: str | None = None,
    gravity: float | None = None,
    method: str = OWN_METHOD,
    wrench_topic: str = "wrench",
    saturation: tuple[float, float] = (np.inf, np.inf),
    settings: PairingSettings | None = None,
    parts: Parts | None = None,
    shape_accuracy: float | None = None,
    progress: Progress = lambda share: None,
) -> Identification:
    """Weigh the payload of a recording.

    Args:
        recording: the wrench; and joint states, tf, or an IMU with a gyroscope. An IMU also helps tf without positions.
        robot_model: for the joint states; None: the recording's robot_description, without which tf is used.
        sensor_frame: frame of the wrench; None: what its messages say.
        base_frame: gravity-aligned frame in tf; None: the topmost.
        gravity: m/s2; None: the recording's metadata record `poise`, key `gravity`, else 9.80665.
        method: `poise`; one of the thesis (`ols`, `rtls`, `geo`, `pmd`, `hps`); `static`, least squares on held poses;
            or `auto`: `static` when half of the samples are at rest and show mass and centre of mass, else `ols`.
        wrench_topic: topic of the sensor.
        saturation: force [N] and torque [N m] at which a channel counts as saturated.
        settings: how wrenches and motion are brought together.
        parts: of the object in the sensor frame; None when nothing is known of its shape.
        shape_accuracy: relative error of lengths in the shape; None: that of a model from CAD.
        progress: is told the share of the work that is done.

    Raises:
        InputError: BAD_INPUT, TOPIC_MISSING, ROBOT_DESCRIPTION_MISSING, FRAME_UNKNOWN, JOINT_MISSING, ...
        NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
    """
    _check(method, gravity, saturation)
    wrench = recording.wrench(wrench_topic)
    frame = _frame(recording, wrench, sensor_frame)
    down = recorded_gravity(recording) if gravity is None else gravity
    kinematics, imu = _motion_of(recording, frame, robot_model, base_frame, down)
    known: dict[str, Any] = {"frame_id": frame, "gravity": down, "saturation": saturation, "settings": settings}
    if method in LEAST_SQUARES:
        return identify_wrenches(wrench, kinematics, method=method, **known)
    samples = collect(wrench, kinematics, imu=imu, progress=lambda share: progress(share / 2), **known)
    later = functools.partial(_second_half, progress)
    return weigh(samples, method, parts=parts, shape_accuracy=shape_accuracy, progress=later)


def _second_half(progress: Progress, share: float) -> None:
    progress((1 + share) / 2)


def _frame(recording: Recording, wrench: WrenchStream, given: str | None) -> str:
    """The sensor's."""
    if given or wrench.frame_id:
        return given or wrench.frame_id
    raise InputError(
        ErrorCode.FRAME_UNKNOWN, f"{recording.path}: the messages of its sensor name no frame: give the sensor frame"
    )


def _motion_of(
    recording: Recording, frame: str, robot_model: RobotModel | None, base_frame: str | None, gravity: float
) -> tuple[Kinematics, Imu | None]:
    """What says how the sensor moved, and the IMU that has to help it."""
    joints_known = robot_model is not None or has_topic(recording, "robot_description")
    if not has_topic(recording, "tf") and not (joints_known and has_topic(recording, "joint_states")):
        imu = find_imu(recording, frame)
        if imu is not None:
            return Kinematics(ImuSource(imu, gravity), []), None
    kinematics = find_kinematics(recording, frame, robot_model, base_frame)
    return kinematics, None if kinematics.has_positions else find_imu(recording, frame)


def identify_wrenches(
    wrench: WrenchStream,
    kinematics: Kinematics,
    *,
    frame_id: str,
    gravity: float = STANDARD_GRAVITY,
    method: str = AUTO,
    saturation: tuple[float, float] = (np.inf, np.inf),
    settings: PairingSettings | None = None,
) -> Identification:
    """Weigh from streams, by handing them to an `OnlineEstimator` as a robot would; see `identify`.

    Raises:
        InputError: BAD_INPUT.
        NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
    """
    estimator = OnlineEstimator(
        kinematics.source,
        frame_id=frame_id,
        gravity=gravity,
        method=method,
        saturation=saturation,
        settings=settings,
        patience=math.inf,
        max_intervals=None,
    )
    paired: dict[str, list[PairedSamples]] = {}
    begin: int | None = None
    for part in np.array_split(np.arange(len(wrench)), CHUNKS):
        if not len(part):
            continue
        end = int(wrench.stamps[part[-1]])
        kinematics.feed(begin, end)
        estimator.add_wrench(wrench.stamps[part], wrench.wrench_in_sensor[part])
        for name, samples in estimator.update().items():
            paired.setdefault(name, []).append(samples)
        begin = end
    kinematics.feed(begin, None)
    for name, samples in estimator.finish().items():
        paired.setdefault(name, []).append(samples)
    answer = estimator.estimate()
    return _identification(answer, _joined(paired[answer.method]), gravity, kinematics.source.words)


def _check(method: str, gravity: float | None, saturation: tuple[float, float]) -> None:
    """Refuse what makes no sense, before anything is read."""
    if method not in METHODS:
        raise InputError(ErrorCode.BAD_INPUT, f"there is no method '{method}'; choose one of {', '.join(METHODS)}")
    for name, value in (("gravity", gravity), ("saturation force", saturation[0]), ("torque", saturation[1])):
        if value is not None and not value > 0:
            raise InputError(ErrorCode.BAD_INPUT, f"{name} is {value}: it must be positive")
    if gravity is not None and gravity > MAX_GRAVITY:
        raise InputError(ErrorCode.BAD_INPUT, f"gravity is {gravity} m/s2: no more than {MAX_GRAVITY:g} is believed")


def recorded_gravity(recording: Recording) -> float:
    """m/s2, of the metadata record `poise`; standard gravity where there is none.

    Raises:
        InputError: BAD_INPUT when it is no positive number.
    """
    text = recording.metadata.get("poise", {}).get("gravity", STANDARD_GRAVITY)
    try:
        gravity = float(text)
    except ValueError:
        gravity = math.nan
    if not (math.isfinite(gravity) and gravity > 0):
        raise InputError(
            ErrorCode.BAD_INPUT, f"{recording.path}: its metadata give gravity as '{text}': give it in m/s2 yourself"
        )
    return gravity


def _joined(parts: list[PairedSamples]) -> PairedSamples:
    """All samples whose motion and wrench are known, used or not, in the order of time."""
    stamps, wrench, reasons = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("stamps", "wrench", "reasons")
    )
    motion = joined([part.motion for part in parts])
    known = np.isfinite(motion.rotation_world_sensor).all(axis=(1, 2)) & (reasons != NOT_FINITE)
    return PairedSamples(stamps[known], wrench[known], motion.select(known), reasons[known])


def _identification(answer: InertialEstimate, samples: PairedSamples, gravity: float, source: str) -> Identification:
    matrix = model_matrix(samples.motion, np.array([0.0, 0.0, -gravity]))
    predicted = matrix @ np.nan_to_num(answer.phi) + np.nan_to_num(answer.bias)
    used = samples.reasons == USED
    return Identification(
        estimate=answer,
        stamps=samples.stamps,
        wrench_measured=samples.wrench,
        wrench_predicted=predicted,
        motion=samples.motion,
        history=_history(answer, samples.stamps[used], matrix[used], samples.wrench[used]),
        source=source,
    )


def _history(answer: InertialEstimate, stamps: Stamps, matrix: Array, wrench: Array) -> tuple[InertialEstimate, ...]:
    """The estimate after every fiftieth of the samples, as soon as there is one; the last is the answer."""
    information = InformationAccumulator()
    history: list[InertialEstimate] = []
    parts = [part for part in np.array_split(np.arange(len(stamps)), HISTORY) if len(part)]
    for part in parts[:-1]:
        information.add(matrix[part], wrench[part])
        stamp = int(stamps[part[-1]])
        try:
            solution = solve(information)
        except NoAnswerError:
            continue
        rejected = tuple(interval for interval in answer.rejected if interval.end <= stamp)
        history.append(
            InertialEstimate.from_solution(
                solution, stamp=stamp, frame_id=answer.frame_id, method=answer.method, rejected=rejected
            )
        )
    return (*history, answer)

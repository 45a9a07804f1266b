"""From a recording to what the sensor carried: the recording is fed to the pipeline that a running robot uses."""

import math

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.bayes import EXTERNAL_CONTACT, SHAPE_ACCURACY
from poise.inertia.estimators import DEFAULT_METHOD, estimator_named, joined, model_matrix
from poise.inertia.model import NOT_FINITE, OUT_OF_ORDER, Parts, RejectedInterval
from poise.inertia.pipeline.estimate import Identification, InertialEstimate, PayloadSegment
from poise.inertia.pipeline.method_pipeline import PairedSamples
from poise.inertia.pipeline.online import OnlineEstimator, check_options
from poise.inertia.pipeline.segments import answer_of, predicted_wrench, weigh_segments
from poise.ranges import check_range
from poise.recording import Recording, WrenchStream, interpolate
from poise.robot import (
    USED,
    FrameTree,
    Imu,
    ImuSource,
    Kinematics,
    LiveImu,
    MotionSource,
    PairingSettings,
    RobotModel,
    find_imu,
    find_kinematics,
    frame_names,
    has_topic,
)
from poise.types import Progress

_CHUNKS = 12
"""A recording is fed in this many pieces. After each, there is an estimate for the history."""

_LARGEST_GAP = 0.1
"""s between samples across which a prediction is not interpolated."""


def identify(
    recording: Recording,
    *,
    robot_model: RobotModel | None = None,
    sensor_frame: str | None = None,
    base_frame: str | None = None,
    gravity: float | None = None,
    method: str = DEFAULT_METHOD,
    wrench_topic: str = "wrench",
    saturation: tuple[float, float] = (np.inf, np.inf),
    settings: PairingSettings | None = None,
    parts: Parts | None = None,
    shape_accuracy: float | None = None,
    keep_history: bool = True,
    progress: Progress = lambda share: None,
) -> Identification:
    """Weigh the payload of a recording.

    Args:
        recording: the wrench; and joint states, tf, or an IMU with a gyroscope. An IMU also helps tf without positions.
        robot_model: for the joint states; None: the recording's robot_description, without which tf is used.
        sensor_frame, base_frame: of the wrench, and gravity-aligned in tf; None: its messages' frame, and the topmost.
        gravity: m/s2; None: the recording's metadata record `poise`, key `gravity`, else 9.80665.
        method, saturation, settings, parts, keep_history, progress: see `OnlineEstimator` and `identify_wrenches`.
        wrench_topic, shape_accuracy: of the sensor; relative error of lengths in the shape, None: of a model from CAD.

    Raises:
        InputError, NoAnswerError: what is missing or wrong, by its code; see `MethodPipeline.estimate` and `Recording`.
    """
    check_options(method, gravity, saturation)
    wrench, foreign = _wrench(recording, wrench_topic)
    frame = _frame(recording, wrench, sensor_frame)
    down = recorded_gravity(recording) if gravity is None else gravity
    kinematics, imu = _motion_of(recording, frame, robot_model, base_frame, down)
    estimator = OnlineEstimator(
        kinematics.source,
        frame_id=frame,
        gravity=down,
        method=method,
        parts=parts,
        accuracy=shape_accuracy or SHAPE_ACCURACY,
        saturation=saturation,
        settings=settings,
        patience=math.inf,
        max_intervals=None,
    )
    estimator.foreign_wrenches.update(foreign)
    if imu is not None and estimator_named(method).uses_imu:
        estimator.take_imu(imu)
    return identify_wrenches(wrench, kinematics, estimator, keep_history=keep_history, progress=progress)


def identify_wrenches(
    wrench: WrenchStream,
    kinematics: Kinematics,
    estimator: OnlineEstimator,
    *,
    keep_history: bool = True,
    progress: Progress = lambda share: None,
) -> Identification:
    """Feed streams to the pipeline; see `identify`.

    Args:
        wrench: of the sensor.
        kinematics: of the sensor, not yet fed; its source is that of the estimator.
        estimator: without samples.
        keep_history: estimate as samples come in, too; False: at the end only, which takes a fifth less time.
        progress: takes the share of the work that is done.

    Raises:
        InputError: UNSUPPORTED.
        NoAnswerError: TOO_FEW_SAMPLES, NOT_IDENTIFIABLE, NOT_CONSISTENT, SOLVER_FAILED.
    """
    paired: dict[str, list[PairedSamples]] = {}
    history: list[InertialEstimate] = []
    pieces = [piece for piece in np.array_split(np.arange(len(wrench)), _CHUNKS) if len(piece)]
    begin: int | None = None
    for number, piece in enumerate(pieces):
        is_last = number + 1 == len(pieces)
        end = None if is_last else int(wrench.stamps[piece[-1]])
        kinematics.feed(begin, end)
        estimator.add_wrench(wrench.stamps[piece], wrench.wrench_in_sensor[piece])
        for name, samples in (estimator.finish() if is_last else estimator.update()).items():
            paired.setdefault(name, []).append(samples)
        begin = end
        if keep_history and not is_last:
            _note(history, estimator)
        progress((number + 1) / len(pieces))
    try:
        return _answered(paired, tuple(history), estimator)
    except NoAnswerError as error:
        if lacking := _without_overlap(wrench, kinematics.source):
            raise NoAnswerError(error.code, f"{error.message}: {lacking}", **error.data) from error
        raise


def _without_overlap(wrench: WrenchStream, source: MotionSource) -> str:
    """The sentence about two streams of which one ends before the other begins; "" where they overlap."""
    newest = source.newest
    moved = source.stamps(0, newest) if newest is not None else wrench.stamps
    if not len(moved) or not len(wrench):
        return ""
    apart = 1e-9 * float(max(wrench.stamps[0] - moved[-1], moved[0] - wrench.stamps[-1]))
    if apart <= 0:
        return ""
    return f"wrench and motion do not overlap, {apart:.3g} s lie between them: are their clocks the same?"


def _answered(
    paired: dict[str, list[PairedSamples]], history: tuple[InertialEstimate, ...], estimator: OnlineEstimator
) -> Identification:
    """The answer for one payload; or, where the payload changed, that of the last object that was held."""
    failure: NoAnswerError | None = None
    try:
        answer: InertialEstimate | None = estimator.estimate()
    except NoAnswerError as error:
        answer, failure = None, error
    method = max(paired, key=lambda name: _count(paired[name])) if answer is None else answer.method
    samples = _joined(paired[method])
    segments = weigh_segments(samples, answer, estimator, method)
    if segments and not _is_contact(answer, segments):
        return _of_segments(segments, samples, () if answer is None else answer.rejected, estimator)
    if answer is None:
        raise failure or NoAnswerError(ErrorCode.EMPTY, "there are no samples")
    before = [past for past in history if past.method == method and past.n_samples < answer.n_samples]
    return _identification(answer, tuple(before), samples, estimator)


def _is_contact(whole: InertialEstimate | None, segments: tuple[PayloadSegment, ...]) -> bool:
    """One payload explains the part that is free of contact, and payloads do not explain a third of the segments."""
    found = [] if whole is None else [each for each in whole.findings if each.code is ErrorCode.IN_CONTACT]
    if not found or "other_mass" in found[0].evidence:
        return False
    doubts = ErrorCode.IN_CONTACT, ErrorCode.POOR_FIT
    doubtful = [segment for segment in segments if any(each.code in doubts for each in segment.estimate.findings)]
    return 3 * len(doubtful) >= len(segments)


def _count(parts: list[PairedSamples]) -> int:
    return sum(int(np.sum(part.reasons == USED)) for part in parts)


def _note(history: list[InertialEstimate], estimator: OnlineEstimator) -> None:
    """Add the estimate of the samples so far, as soon as there is one, where samples have come."""
    if not estimator.n_samples:
        return
    try:
        found = estimator.estimate()
    except NoAnswerError:
        return
    if not history or found.n_samples > history[-1].n_samples:
        history.append(found)


def _wrench(recording: Recording, topic: str) -> tuple[WrenchStream, dict[str, int]]:
    """The wrenches of the frame that is named first, and how many there are of each other frame."""
    try:
        return recording.wrench(topic), {}
    except InputError as error:
        if error.code is not ErrorCode.FRAME_UNKNOWN:
            raise
    first, *others = (counts := recording.wrench_frames(topic))
    return recording.wrench(topic, first), {name: counts[name] for name in others}


def _frame(recording: Recording, wrench: WrenchStream, given: str | None) -> str:
    """The sensor's."""
    if given or wrench.frame_id:
        return given or wrench.frame_id
    raise InputError(
        ErrorCode.FRAME_UNKNOWN,
        f"{recording.path}: the messages of its sensor name no frame: give the sensor frame (--sensor-frame), of"
        f" {', '.join(frame_names(recording)) or 'those of your robot'}",
    )


def _motion_of(
    recording: Recording, frame: str, robot_model: RobotModel | None, base_frame: str | None, gravity: float
) -> tuple[Kinematics, LiveImu | None]:
    """The motion of the sensor, and the IMU that it needs for the linear acceleration."""
    joints_known = robot_model is not None or has_topic(recording, "robot_description")
    if not has_topic(recording, "tf") and not (joints_known and has_topic(recording, "joint_states")):
        imu = find_imu(recording, frame)
        if imu is not None:
            return Kinematics(ImuSource(imu, gravity), []), None
    kinematics = find_kinematics(recording, frame, robot_model, base_frame)
    imu = None if kinematics.has_positions else find_imu(recording, frame)
    return kinematics, None if imu is None else _fed_imu(imu, gravity)


def _fed_imu(imu: Imu, gravity: float) -> LiveImu:
    """All samples of a recorded IMU, which are in sensor axes already."""
    found = LiveImu(FrameTree(), np.array([0.0, 0.0, -gravity]), imu.topic)
    found.take(imu)
    return found


def recorded_gravity(recording: Recording) -> float:
    """m/s2, of the metadata record `poise`; standard gravity where there is none.

    Raises:
        InputError: BAD_INPUT when it is none of a planet.
    """
    text = recording.metadata.get("poise", {}).get("gravity", STANDARD_GRAVITY)
    try:
        gravity = float(text)
    except ValueError:
        gravity = math.nan
    check_range("gravity of a recording", gravity, f"{recording.path}: the metadata record poise: ")
    return gravity


def _joined(parts: list[PairedSamples]) -> PairedSamples:
    """All samples whose motion and wrench are known, used or not, in the order of time."""
    stamps, wrench, reasons = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("stamps", "wrench", "reasons")
    )
    motion = joined([part.motion for part in parts])
    known = np.isfinite(motion.rotation_world_sensor).all(axis=(1, 2)) & ~np.isin(reasons, (NOT_FINITE, OUT_OF_ORDER))
    return PairedSamples(stamps[known], wrench[known], motion.select(known), reasons[known])


def _identification(
    answer: InertialEstimate, before: tuple[InertialEstimate, ...], samples: PairedSamples, estimator: OnlineEstimator
) -> Identification:
    """The answer with its samples; predictions are for the samples as they were stamped."""
    motion, errors = samples.motion, answer.accelerometer
    if errors is not None:
        motion = errors.true_motion(motion, estimator.gravity)
    predicted = model_matrix(motion, estimator.gravity) @ np.nan_to_num(answer.phi)
    if np.nan_to_num(answer.delay):
        then = samples.stamps - round(answer.delay * 1e9)
        predicted = interpolate(samples.stamps, predicted, then, max_gap=_LARGEST_GAP).values
    return Identification(
        estimate=answer,
        stamps=samples.stamps,
        wrench_measured=samples.wrench,
        wrench_predicted=predicted + np.nan_to_num(answer.bias),
        motion=motion,
        history=(*before, answer),
        source=estimator.motion_words,
        segments=(PayloadSegment(_first(samples), answer.stamp, _first(samples), "start", np.nan, answer),),
    )


def _of_segments(
    segments: tuple[PayloadSegment, ...],
    samples: PairedSamples,
    rejected: tuple[RejectedInterval, ...],
    estimator: OnlineEstimator,
) -> Identification:
    """The answer where the payload changed, with samples and predictions of all segments."""
    answer = answer_of(segments, tuple(span for span in rejected if span.reason != EXTERNAL_CONTACT))
    return Identification(
        estimate=answer,
        stamps=samples.stamps,
        wrench_measured=samples.wrench,
        wrench_predicted=predicted_wrench(segments, samples.motion, estimator.gravity),
        motion=samples.motion,
        history=(answer,),
        source=estimator.motion_words,
        segments=segments,
    )


def _first(samples: PairedSamples) -> int:
    """Stamp of the first sample, ns."""
    return int(samples.stamps[0]) if len(samples.stamps) else 0

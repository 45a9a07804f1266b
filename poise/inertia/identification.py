"""From a recording to what the sensor carried: chooses the kinematics, pairs them with the wrenches, and weighs."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.inertia.buffer import Stamps
from poise.inertia.estimate import Identification, InertialEstimate
from poise.inertia.findings import RejectedInterval
from poise.inertia.information import InformationAccumulator
from poise.inertia.least_squares import solve
from poise.inertia.online import OnlineEstimator
from poise.inertia.parameters import Array
from poise.inertia.recorder import NOT_FINITE
from poise.inertia.sources import FrameSource, JointSource, MotionSource
from poise.inertia.tracks import USED, PairingSettings
from poise.inertia.weighers import AUTO, METHODS, check_method, joined, model_matrix
from poise.inertia.weighing import PairedSamples
from poise.recording import PoseStream, Recording, WrenchStream
from poise.robot import STANDARD_GRAVITY, RobotModel

__all__ = ["METHODS", "Identification", "InertialEstimate", "RejectedInterval", "identify", "identify_wrenches"]

HISTORY = 50
"""How many points show the estimate closing in."""

CHUNKS = 20
"""A recording is fed in this many pieces, so that its kinematics do not have to be remembered all at once."""


@dataclass
class Kinematics:
    """The kinematics of a recording, to be fed to a source in the order of time.

    Args:
        source: takes them.
        parts: stamps (N,) and what adds the samples of a slice to the source.
    """

    source: MotionSource
    parts: list[tuple[Stamps, Callable[[slice], None]]]

    def feed(self, begin: int | None, end: int | None) -> None:
        """Add what is stamped after `begin` and no later than `end`; None: no limit."""
        for stamps, add in self.parts:
            low = 0 if begin is None else int(np.searchsorted(stamps, begin, "right"))
            high = len(stamps) if end is None else int(np.searchsorted(stamps, end, "right"))
            if high > low:
                add(slice(low, high))


def identify(
    recording: Recording,
    *,
    robot_model: RobotModel | None = None,
    sensor_frame: str | None = None,
    base_frame: str | None = None,
    gravity: float | None = None,
    method: str = AUTO,
    wrench_topic: str = "wrench",
    saturation: tuple[float, float] = (np.inf, np.inf),
    settings: PairingSettings | None = None,
) -> Identification:
    """Weigh the payload of a recording.

    Args:
        recording: holds the wrench, and either joint states or tf up to the sensor frame.
        robot_model: for the joint states; None: the recording's robot_description, without which tf is used.
        sensor_frame: frame of the wrench; None: what its messages say.
        base_frame: gravity-aligned frame in tf; None: the topmost.
        gravity: m/s2; None: the recording's metadata record `poise`, key `gravity`, else 9.80665.
        method: `static` (held poses), `ols` (motion), or `auto`: `static` when at least half of the samples are at rest
            and show mass and centre of mass, else `ols`.
        wrench_topic: topic of the sensor.
        saturation: force [N] and torque [N m] at which a channel counts as saturated.
        settings: how wrenches and motion are brought together.

    Raises:
        InputError: BAD_INPUT, TOPIC_MISSING, ROBOT_DESCRIPTION_MISSING, FRAME_UNKNOWN, JOINT_MISSING, ...
        NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
    """
    check_method(method)
    wrench = recording.wrench(wrench_topic)
    frame = sensor_frame or wrench.frame_id
    if not frame:
        raise InputError(
            ErrorCode.FRAME_UNKNOWN,
            f"{recording.path}: the messages of {wrench_topic} name no frame: give the sensor frame",
        )
    kinematics = find_kinematics(recording, frame, robot_model, base_frame)
    return identify_wrenches(
        wrench,
        kinematics,
        frame_id=frame,
        gravity=recorded_gravity(recording) if gravity is None else gravity,
        method=method,
        saturation=saturation,
        settings=settings,
    )


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


def find_kinematics(
    recording: Recording, sensor_frame: str, robot_model: RobotModel | None = None, base_frame: str | None = None
) -> Kinematics:
    """Joint states with a robot model where there are both, else tf.

    Raises:
        InputError: when the recording has neither, or the sensor frame is in neither.
    """
    joints, frames = _has(recording, "joint_states"), _has(recording, "tf")
    if robot_model is None and joints and _has(recording, "robot_description"):
        try:
            robot_model = RobotModel.from_urdf(recording.robot_description(), sensor_frame)
        except InputError as error:
            if error.code is not ErrorCode.FRAME_UNKNOWN or not frames:
                raise InputError(error.code, f"{recording.path}: {error.message}", **error.data) from error
    if robot_model is not None:
        return _joint_kinematics(recording, robot_model)
    if frames:
        return _frame_kinematics(recording, sensor_frame, base_frame)
    if joints:
        raise InputError(
            ErrorCode.ROBOT_DESCRIPTION_MISSING,
            f"{recording.path} has joint_states, but no robot_description: give a URDF file, or record it too",
        )
    raise InputError(
        ErrorCode.TOPIC_MISSING,
        f"{recording.path} does not say how {sensor_frame} moved: record joint_states with robot_description,"
        f" or tf up to {sensor_frame}",
    )


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


def _has(recording: Recording, topic: str) -> bool:
    try:
        recording.topic(topic)
    except InputError as error:
        if error.code is ErrorCode.TOPIC_MISSING:
            return False
        raise
    return True


def _joint_kinematics(recording: Recording, model: RobotModel) -> Kinematics:
    stream = recording.joint_states(names=model.joint_names)
    source = JointSource(model)

    def add(part: slice) -> None:
        source.extend(stream.stamps[part], stream.names, stream.position[part], stream.velocity[part])

    return Kinematics(source, [(stream.stamps, add)])


def _frame_kinematics(recording: Recording, sensor_frame: str, base_frame: str | None) -> Kinematics:
    """Every transform from the sensor up to the base."""
    source = FrameSource(sensor_frame, base_frame)
    streams: list[PoseStream] = []
    frame = sensor_frame
    while frame != base_frame:
        try:
            stream = recording.poses(frame)
        except InputError as error:
            if error.code is ErrorCode.FRAME_UNKNOWN and streams and base_frame is None:
                break  # the top of the tree
            raise
        if any(stream.parent in (frame, other.child) for other in streams):
            raise InputError(ErrorCode.FRAME_UNKNOWN, f"{recording.path}: tf goes round in a circle at {stream.parent}")
        streams.append(stream)
        frame = stream.parent
    still = [_is_constant(stream) for stream in streams]
    if all(still):  # then all is rest, which the samples of the first one may say
        still[0] = False
    parts: list[tuple[Stamps, Callable[[slice], None]]] = []
    for stream, fixed in zip(streams, still, strict=True):
        add = _adder(source, stream, fixed)
        if fixed:
            add(slice(None))
        else:
            parts.append((stream.stamps, add))
    return Kinematics(source, parts)


def _is_constant(stream: PoseStream) -> bool:
    rotation, translation = stream.rotation_parent_child, stream.translation_parent_child
    return bool(np.all(rotation == rotation[:1]) and np.all(translation == translation[:1]))


def _adder(source: FrameSource, stream: PoseStream, fixed: bool) -> Callable[[slice], None]:
    def add(part: slice) -> None:
        source.extend(
            stream.stamps[part],
            stream.parent,
            stream.child,
            stream.rotation_parent_child[part],
            stream.translation_parent_child[part],
            fixed=fixed,
        )

    return add


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

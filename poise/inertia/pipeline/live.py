"""Weighing on a running robot: takes messages as they come, chooses the source of motion, feeds the pipeline."""

from collections import Counter, deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose, are_rotations
from poise.inertia.bayes import SHAPE_ACCURACY, PayloadChange
from poise.inertia.estimators import AUTO, check_method, estimator_named
from poise.inertia.model import Parts
from poise.inertia.pipeline.estimate import InertialEstimate
from poise.inertia.pipeline.live_options import ALWAYS, FRAMES, IMUS, JOINTS, NEVER, SOURCES, LiveOptions
from poise.inertia.pipeline.online import OnlineEstimator
from poise.robot import (
    FrameSource,
    FrameTree,
    JointSource,
    LiveImu,
    MotionSource,
    RobotModel,
    parse_urdf,
    robot_on_odometry,
)
from poise.types import Array

GRACE = 1.0
"""s that tf waits, in `auto`, for joint states and a robot description: they are the better source."""
_EARLY, _EARLY_SPAN = 20_000, 20.0
"""Wrenches and joint states, and s of tf, that are kept until the source of the motion is chosen."""
_RECENT = 4000
"""Joint states and odometry that are kept for the source that replaces the present one when the base begins to move."""


class LiveEstimator:
    """Takes messages in any order, one at a time. `now` is s of any clock that never goes back.

    Raises:
        InputError: BAD_INPUT for options that make no sense.
    """

    def __init__(self, options: LiveOptions) -> None:
        check_method(options.method)
        for what, name, choice in (("motion source", options.motion_source, SOURCES), ("imu", options.imu, IMUS)):
            if name not in choice:
                raise InputError(ErrorCode.BAD_INPUT, f"there is no {what} '{name}'; choose one of {', '.join(choice)}")
        self.options = options
        self.frames = FrameSource(options.sensor_frame, options.base_frame or None, options.settings.max_gap)
        self.joints: JointSource | None = None
        self.estimator: OnlineEstimator | None = None
        """None until it is clear where the motion comes from."""
        self.parts, self.accuracy = options.parts, options.accuracy
        """Of the payload, in the sensor frame; and the relative error of its lengths."""
        self.hand = FrameTree(one_parent=False, keep=False)
        """Frames that the shape of the payload may be given in."""
        self.imu = LiveImu(self.hand, np.array([0.0, 0.0, -options.gravity]))
        """What has come of it, used or not."""
        self.problem: InputError | None = None
        """Why the robot description cannot be used."""
        self.foreign_wrenches: Counter[str] = Counter()
        """Wrenches of other frames than the first one's, by frame."""
        self.early_joints: deque[tuple[int, Sequence[str], ArrayLike, ArrayLike]] = deque(maxlen=_EARLY)
        """Joint states that wait for a robot description."""
        self._recent_joints: deque[tuple[int, Sequence[str], ArrayLike, ArrayLike]] = deque(maxlen=_RECENT)
        self._odometry: deque[tuple[int, Array, Array]] = deque(maxlen=_RECENT)
        self.base_moves, self.invalid_odometry = False, 0
        """Odometry has shown motion and is needed from then on; poses of it that were left out."""
        self.heard: dict[str, float] = {}
        """When a wrench and usable kinematics came last."""
        self._wrench_frame = ""
        self._description = ""
        self._early: deque[tuple[int, ArrayLike]] = deque(maxlen=_EARLY)
        self._frames_since = np.inf
        self._flushed = True
        self._estimator_for(self.frames)  # what makes no sense is refused now

    @property
    def sensor_frame(self) -> str:
        """The frame of the estimate; empty while it is not known."""
        return self.options.sensor_frame or self._wrench_frame

    # -- what comes in ---------------------------------------------------------------------------------------

    def add_wrench(self, stamp: int, frame_id: str, wrench: ArrayLike, now: float) -> None:
        """Take a wrench (6,), N and N m, stamped in ns; one of another frame than the first is counted, not used."""
        self.heard["wrench"] = now
        if frame_id and not self._wrench_frame:
            self._wrench_frame = frame_id
            self.frames.sensor_frame = self.sensor_frame
            self._note_frames(now)  # tf may have come first
            self._read_description(now)
        if frame_id != self._wrench_frame:
            self.foreign_wrenches[frame_id] += 1
        elif self.estimator is None:
            self._early.append((stamp, wrench))
        else:
            self.estimator.add_wrench(stamp, wrench)
        self._flushed = False

    def set_robot_description(self, text: str, now: float) -> None:
        """Take a URDF. Another one than before starts the estimate afresh; an invalid one changes nothing.

        Raises:
            InputError: ROBOT_DESCRIPTION_INVALID, FRAME_UNKNOWN or UNSUPPORTED, see `RobotModel.from_urdf`. While the
                sensor frame is not known, only what is no URDF is refused.
        """
        if text == self._description or self.options.motion_source == FRAMES:
            return
        try:
            self._robot_of(text) if self.sensor_frame else parse_urdf(text)
        except InputError as error:
            if not self._description:
                self.problem = error
            raise
        self._description, self.problem = text, None
        if self._uses(self.joints):
            self.estimator = None
        self.joints = None
        self._read_description(now)

    def add_joint_state(
        self, stamp: int, names: Sequence[str], position: ArrayLike, velocity: ArrayLike, now: float
    ) -> None:
        """Take a joint state, (K,) each; no velocities: an empty array."""
        if self.options.motion_source == FRAMES:
            return
        if self.joints is None:
            self.early_joints.append((stamp, names, position, velocity))
            return
        self._recent_joints.append((stamp, names, position, velocity))
        rates = np.asarray(velocity, dtype=np.float64)
        if self.joints.extend([stamp], names, np.asarray(position)[None], rates[None] if rates.size else None):
            self._has_moved(now)
            if not self._uses(self.joints):
                self._choose(self.joints)

    def add_odometry(self, stamp: int, rotation: ArrayLike, translation: ArrayLike, now: float) -> None:
        """Take the pose of the root link in the world, (3, 3) and (3,) m; it counts once it shows motion."""
        if self.options.motion_source == FRAMES:
            return
        turn, shift = np.asarray(rotation, dtype=np.float64), np.asarray(translation, dtype=np.float64)
        if not (are_rotations(turn) and np.isfinite(shift).all()):
            self.invalid_odometry += 1
            return
        self.heard["odometry"] = now
        self._odometry.append((stamp, turn, shift))
        if self.base_moves:
            if self.joints is not None:
                self.joints.add_odometry([stamp], turn[None], shift[None])
            return
        _, first_turn, first_shift = self._odometry[0]
        self.base_moves = not (np.array_equal(turn, first_turn) and np.array_equal(shift, first_shift))
        if self.base_moves and self.joints is not None:
            self.early_joints.extend(self._recent_joints)
            self._recent_joints.clear()
            self.joints = None
            self._read_description(now)

    def add_transform(
        self, stamp: int, parent: str, child: str, rotation: ArrayLike, translation: ArrayLike, fixed: bool, now: float
    ) -> None:
        """Take a transform, (3, 3) and (3,) m; `fixed` when it comes from tf_static.

        Raises:
            InputError: FRAME_UNKNOWN when a frame changes its parent.
        """
        turn, shift = np.asarray(rotation)[None], np.asarray(translation)[None]
        self.hand.add([stamp], parent, child, turn, shift, fixed=fixed)
        if self.options.motion_source == JOINTS or self._uses(self.joints):
            return
        used = self.frames.extend([stamp], parent, child, turn, shift, fixed=fixed)
        if used and not fixed:
            self._note_frames(now)

    def pose_in_sensor(self, frame: str) -> Pose:
        """The pose of a frame, such as the object's, in the sensor's.

        Raises:
            InputError: FRAME_UNKNOWN when tf does not join them, or the frame does not move with the sensor.
        """
        pose = self.hand.pose(frame, self.sensor_frame)
        in_hand = self.hand.ancestors(self.sensor_frame, fixed_only=True).keys() & self.hand.ancestors(frame).keys()
        if pose is None or not in_hand:
            said = "does not move with" if pose is not None else "is not connected by tf with"
            what = f"frame {frame} {said} {self.sensor_frame or 'the sensor'}, so the shape is not used: publish the"
            raise InputError(
                ErrorCode.FRAME_UNKNOWN, f"{what} object's pose in the hand, or give it in the sensor frame"
            )
        return pose

    def add_imu(self, stamp: int, frame_id: str, acceleration: ArrayLike) -> None:
        """Take the linear acceleration (3,) m/s2 of an IMU, in its own axes, gravity's reaction included."""
        if self.options.imu != NEVER:
            self.imu.add(stamp, frame_id, acceleration)

    # -- what comes out --------------------------------------------------------------------------------------

    @property
    def n_samples(self) -> int:
        """Samples used."""
        return 0 if self.estimator is None else self.estimator.n_samples

    def update(self, now: float) -> None:
        """Bring together what has come in; call it some tens of times a second."""
        patience = GRACE if self.options.motion_source == AUTO else 0.0
        if self.estimator is None and self.sensor_frame and now - self._frames_since >= patience:
            self._choose(self.frames)
        if self.estimator is None or self.estimator.imu is None:
            self.imu.keep_last(_EARLY_SPAN)
        if self.estimator is None:
            self.frames.keep_last(_EARLY_SPAN)
            return
        self._take_imu()
        quiet = now - max(self.heard.values(), default=now) > self.options.flush_after
        if not self._flushed:
            self.estimator.update(flush=quiet)
            self._flushed = quiet

    def reset(self, parts: Parts | None = None) -> None:
        """Forget all samples: another payload, of this shape in the sensor frame; None: not known."""
        self._early.clear()
        self.parts = parts
        if self.base_moves:  # until odometry shows motion again
            self.base_moves, self.joints, self.estimator = False, None, None
            self._odometry.clear()
            self._read_description(0.0)
        if self.estimator is not None:
            self.estimator.reset(parts)

    def hold(self, parts: Parts, accuracy: float = SHAPE_ACCURACY) -> None:
        """Say of what shape the payload is, in the sensor frame; or the next one, see `OnlineEstimator.hold`."""
        if self.estimator is None:
            self.parts, self.accuracy = parts, accuracy
        else:
            self.estimator.hold(parts, accuracy)

    @property
    def changes(self) -> list[PayloadChange]:
        """Of the payload, in the order of time."""
        return [] if self.estimator is None else self.estimator.changes

    def estimate(self) -> InertialEstimate:
        """Solve for everything since the start or the last reset.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """
        return self._known().estimate()

    # -- a separate window ------------------------------------------------------------------------------------

    def begin_window(self, method: str = "", parts: Parts | None = None, accuracy: float | None = None) -> None:
        """Weigh what comes from now on separately; see `OnlineEstimator.begin_window`.

        Raises:
            NoAnswerError: TOO_FEW_SAMPLES when it is not known yet how the sensor moves.
            InputError: BUSY or BAD_INPUT.
        """
        self._known().begin_window(method, parts, accuracy)

    @property
    def window_samples(self) -> int:
        """Samples used in the window."""
        return 0 if self.estimator is None else self.estimator.window_samples

    @property
    def window_decided(self) -> int | None:
        """ns: up to which stamp the window's samples are in; None: none are."""
        return None if self.estimator is None else self.estimator.window_decided

    def window_estimate(self) -> InertialEstimate:
        """Solve for everything in the window.

        Raises:
            NoAnswerError: EMPTY without a window, TOO_FEW_SAMPLES or NOT_IDENTIFIABLE.
        """
        return self._known().window_estimate()

    def end_window(self, keep: bool = False) -> None:
        """Close the window, if there is one; with `keep` it takes the place of the running estimate."""
        if self.estimator is not None:
            self.estimator.end_window(keep)

    def _known(self) -> OnlineEstimator:
        if self.estimator is None:
            raise NoAnswerError(
                ErrorCode.TOO_FEW_SAMPLES,
                f"nothing says yet how {self.sensor_frame or 'the sensor'} moves: publish joint_states and "
                "robot_description, or tf up to it",
            )
        return self.estimator

    def _has_moved(self, now: float) -> None:
        self.heard["kinematics"] = now
        self._flushed = False

    def _note_frames(self, now: float) -> None:
        """Note that tf says how the sensor moves, if it does."""
        if self.frames.newest is not None:
            self._has_moved(now)
            self._frames_since = min(self._frames_since, now)

    def _read_description(self, now: float) -> None:
        """Build the robot once both its description and the sensor frame are known."""
        if not self._description or not self.sensor_frame or self.joints is not None:
            return
        try:
            self.joints = JointSource(self._robot_of(self._description))
            self.problem = None
        except InputError as error:
            self.problem = error
            return
        if self.base_moves:
            for stamp, turn, shift in self._odometry:
                self.joints.add_odometry([stamp], turn[None], shift[None])
        while self.early_joints:
            self.add_joint_state(*self.early_joints.popleft(), now)

    def _robot_of(self, text: str) -> RobotModel:
        robot = RobotModel.from_urdf(text, self.sensor_frame)
        return robot_on_odometry(robot, text, self._has_joints) if self.base_moves else robot

    def _has_joints(self, names: tuple[str, ...]) -> bool:
        """Some joint state contains these joints; True before the first one."""
        return not self.early_joints or any(set(names) <= set(message[1]) for message in self.early_joints)

    def _take_imu(self) -> None:
        """Once it is known how it is mounted, and wanted."""
        estimator = self.estimator
        if estimator is None or estimator.imu is not None:
            return
        lacking = estimator.source is self.frames and not self.frames.has_positions
        lacking &= estimator_named(self.options.method).uses_imu
        if (lacking or self.options.imu == ALWAYS) and self.imu.rides_on(self.sensor_frame):
            estimator.take_imu(self.imu)

    def _uses(self, source: MotionSource | None) -> bool:
        return source is not None and self.estimator is not None and self.estimator.source is source

    def _choose(self, source: MotionSource) -> None:
        if self.estimator is None:
            self.estimator = self._estimator_for(source)
        else:
            self.estimator.change_source(source)
        self._take_imu()
        for stamp, wrench in self._early:
            self.estimator.add_wrench(stamp, wrench)
        self._early.clear()

    def _estimator_for(self, source: MotionSource) -> OnlineEstimator:
        estimator = OnlineEstimator(
            source,
            frame_id=self.sensor_frame,
            gravity=self.options.gravity,
            method=self.options.method,
            parts=self.parts,
            accuracy=self.accuracy,
            noise=self.options.noise,
            window=self.options.window,
            continuous=self.options.continuous,
            saturation=self.options.saturation,
            settings=self.options.settings,
        )
        estimator.foreign_wrenches = self.foreign_wrenches
        return estimator

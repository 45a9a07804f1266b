"""How a live estimator is doing: one sentence, what to do about it, and the counts behind it."""

from dataclasses import dataclass
from enum import IntEnum

from poise.inertia.pipeline.live import LiveEstimator

_SILENCE = 1.0
"""s without wrenches or kinematics that are worth a warning."""
_MUCH_REJECTED = 0.5
"""Share of rejected samples, other than for moving, that is worth a warning."""


class Level(IntEnum):
    """The numbers of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Status:
    """How it goes."""

    level: Level
    message: str
    values: dict[str, str]


def status_of(live: LiveEstimator, now: float) -> Status:
    """Judge a live estimator at a time in s of the clock it was given."""
    level, message = _judge(live, now)
    return Status(level, message, _values(live, now))


def _judge(live: LiveEstimator, now: float) -> tuple[Level, str]:
    wrench, kinematics = live.heard.get("wrench"), live.heard.get("kinematics")
    if wrench is None:
        return Level.WARN, "no wrench yet: is the sensor's driver running, and the topic remapped?"
    if not live.sensor_frame:
        there = ", ".join(live.frames.tree.frames)
        return Level.ERROR, "the wrenches name no frame: set the parameter sensor_frame" + f", of {there}" * bool(there)
    if live.problem is not None and live.estimator is None:
        return Level.ERROR, live.problem.message
    odometry = live.heard.get("odometry")
    if live.base_moves and odometry is not None and now - odometry > _SILENCE:
        return (
            Level.ERROR,
            f"no odometry for {now - odometry:.1f} s, and the base has moved: publish odom, or call reset_estimate when"
            " the base stands",
        )
    if kinematics is None:
        return Level.ERROR, _no_kinematics(live)
    if now - wrench > _SILENCE:
        return Level.WARN, f"no wrench for {now - wrench:.1f} s"
    if now - kinematics > _SILENCE:
        return Level.ERROR, f"no usable kinematics for {now - kinematics:.1f} s"
    if live.estimator is None:
        return Level.WARN, "waiting for joint_states before tf is used"
    return _judge_samples(live)


def _judge_samples(live: LiveEstimator) -> tuple[Level, str]:
    rejected = dict(live.estimator.rejected) if live.estimator else {}
    rejected.pop("moving", None)
    total = sum(rejected.values())
    if total and total >= _MUCH_REJECTED * (total + live.n_samples):
        worst = max(rejected, key=lambda reason: rejected[reason])
        return Level.WARN, f"{total} samples cannot be used, most of them because of {worst}{_clocks(live)}"
    if not live.n_samples:
        return Level.WARN, f"no sample can be used yet{_clocks(live)}"
    return Level.OK, f"{live.n_samples} samples used"


def _no_kinematics(live: LiveEstimator) -> str:
    if live.joints is not None and live.joints.foreign:
        names = ", ".join(live.joints.model.joint_names)
        return f"joint_states come, but none has all joints that move {live.sensor_frame}: {names}"
    if live.joints is not None and live.joints.not_finite:
        return "joint_states come, but with positions that are no finite numbers"
    if live.early_joints:
        return "joint_states come, but no robot_description: publish it (transient local)"
    if live.frames.tree.frames:
        return f"tf comes, but does not connect {live.options.base_frame or 'any frame'} with {live.sensor_frame}"
    return f"nothing says how {live.sensor_frame} moves: publish joint_states and robot_description, or tf up to it"


def _clocks(live: LiveEstimator) -> str:
    """A note on clocks that are far apart."""
    apart = None if live.estimator is None else live.estimator.clocks_apart
    if apart is None or abs(apart) < _SILENCE:
        return ""
    where = "ahead of" if apart > 0 else "behind"
    return f"; wrench stamps are {abs(apart):.1f} s {where} the kinematics: check the clocks"


def _values(live: LiveEstimator, now: float) -> dict[str, str]:
    values = {
        "sensor_frame": live.sensor_frame,
        "motion": live.estimator.motion_words if live.estimator else "not chosen yet",
        "samples_used": str(live.n_samples),
        "wrenches_of_other_frames": str(live.foreign_wrenches.total()),
        "joint_states_of_others": str(live.joints.foreign if live.joints else 0),
        "kinematics_not_finite": str(live.frames.not_finite + (live.joints.not_finite if live.joints else 0)),
        "invalid_odometry": str(live.invalid_odometry),
        "clock_jumps": str(live.estimator.clock_jumps if live.estimator else 0),
    }
    if live.problem is not None:
        values["robot_description"] = live.problem.message
    for name, when in live.heard.items():
        values[f"{name}_age"] = f"{now - when:.3f}"
    for reason, count in (live.estimator.rejected if live.estimator else {}).items():
        values[f"rejected_{reason}"] = str(count)
    return values

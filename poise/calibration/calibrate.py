"""The calibration of a camera on a hand, with what makes it doubtful: too little motion, a wrong board, a slip."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from poise.calibration.adjustment import BOARD, EYE, BoardFit, BoardProblem, Parameters, adjust, jackknife
from poise.calibration.recording_checks import LEAST_VIEWS, require_finite, require_places, require_turns
from poise.calibration.sightings import (
    LEAST_CORNERS,
    CameraCarrier,
    Sighting,
    board_pose,
    closed_form,
    joints_of,
    show_a_plane,
)
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose
from poise.scanning import Camera
from poise.types import Array, Cancelled, Mask

_CORNER, _CORNER_LEAST = 5.0, 1.0
"""Times the noise, and pixels, from which on a corner is an outlier."""
_VIEW = 4.0
"""Times the typical error from which on a view is an outlier."""
_ROUNDS = 4
"""Fits, each without the outliers of the one before."""
_MOST_OUTLIERS = 0.25
_SAME = 1e-3
"""Share of a parameter's effect that others must not explain."""
_OFFSET, _DELAY = 0.01, 0.03
"""rad and s: one sigma above which an offset or the delay is not identified, and what it may then be."""
_SCALE, _SCALE_SIGMA = 0.01, 0.02
_CHANCE = 1e-4
"""Of a false alarm."""
_NOT_THIS_ROBOT = 0.05
"""m, in closed form."""
_FAR = 3e-3
"""m at the board that views disagree, typically, from which on there is no answer."""


@dataclass(frozen=True)
class HandEyeOptions:
    """What is estimated besides the hand-eye transform.

    Args:
        offsets: zero offsets of the joints.
        delay: of the stamps of images.
    """

    offsets: bool = True
    delay: bool = True


@dataclass(frozen=True, eq=False)
class HandEyeCalibration:
    """The answer.

    Args:
        link: that carries the camera.
        joint_names: (J).
        parameters: the estimate; what is not identified is 0.
        covariance: (14 + J, 14 + J) of the steps of `Parameters.moved`.
        identified: (J,) which joint offsets were estimated; delay_identified: whether the delay was.
        reasons: why others were not, by name.
        views, rejected: number of views that were used; stamps, ns, of outliers.
        corners_rejected: number of outliers among the corners.
        noise: pixels, one sigma of a corner within one view.
        rms: pixels, over all views.
        disagreement: m, how far the views have the board from each other, typically.
        scale, scale_sigma: size of the board through the stated one, estimated alone for the verdict.
        halves: probability that the two halves of the recording differ by as much as they do, if nothing changed.
        notes: to read it with.
    """

    link: str
    joint_names: tuple[str, ...]
    parameters: Parameters
    covariance: Array
    identified: Mask
    delay_identified: bool
    reasons: dict[str, str]
    views: int
    rejected: tuple[int, ...]
    corners_rejected: int
    noise: float
    rms: float
    disagreement: float
    scale: float
    scale_sigma: float
    halves: float
    notes: tuple[str, ...] = ()

    @property
    def eye_sigma(self) -> Array:
        """(6,) rad about the link's axes, and m."""
        return np.sqrt(np.diag(self.covariance)[EYE])


def calibrate(
    kinematics: CameraCarrier,
    link: str,
    camera: Camera,
    sightings: Sequence[Sighting],
    options: HandEyeOptions = HandEyeOptions(),
    cancelled: Cancelled = lambda: False,
) -> HandEyeCalibration:
    """Estimate the hand-eye transform from views of a flat board that stands still.

    Args:
        kinematics: of the link that carries the camera.
        link: its name.
        camera: intrinsics.
        sightings: in the order of time.
        options: what else is estimated.
        cancelled: whether to give up.

    Raises:
        InputError: EMPTY without a view of the board; NOT_FINITE; BAD_INPUT when the board has another size.
        NoAnswerError: TOO_FEW_SAMPLES, NOT_IDENTIFIABLE, POOR_FIT, CANCELLED.
    """
    require_finite(sightings)
    seen, boards, noise, dropped = _sound(sightings, camera)
    require_places(seen)
    links = kinematics.poses(joints_of(seen)[0])
    require_turns(links)
    start = _start(links, boards, len(kinematics.joint_names))
    fit, kept, reasons = _fitted(kinematics, camera, seen, start, options, cancelled)
    used = [each for each, keep in zip(seen, kept, strict=True) if keep]
    rejected = tuple(each.stamp for each, keep in zip(seen, kept, strict=True) if not keep)
    if len(rejected) > _MOST_OUTLIERS * len(seen):
        raise NoAnswerError(
            ErrorCode.POOR_FIT,
            f"calibrate: {len(rejected)} of {len(seen)} views do not fit the others: the board slipped, images are late"
            " or the robot description is not this robot's",
        )
    depth = float(np.median([pose.translation[2] for pose, keep in zip(boards, kept, strict=True) if keep]))
    require_places(used)
    problem = BoardProblem(kinematics, camera, used)
    return _judged(problem, fit, kinematics.joint_names, reasons, depth / camera.fx, (link, rejected, dropped, noise))


def _judged(
    problem: BoardProblem,
    fit: BoardFit,
    names: tuple[str, ...],
    reasons: dict[str, str],
    size: float,
    seen: tuple[str, tuple[int, ...], int, float],
) -> HandEyeCalibration:
    """The answer, when nothing speaks against it.

    Args:
        problem, fit: of the views that were used.
        names: of the joints.
        reasons: why something is not identified.
        size: m of a pixel at the board.
        seen: link, stamps of outliers, number of outliers among corners, and their noise, pixels.
    """
    link, rejected, dropped, noise = seen
    rms = float(np.sqrt(np.mean(fit.errors**2)))
    disagreement = _require_agreement(rms, noise, size)
    scale, scale_sigma = _require_size(problem, fit)
    if scale_sigma > _SCALE_SIGMA:
        reasons["board_scale"] = f"sigma {scale_sigma:.0%}: the size of the board is taken as stated"
    joints = len(names)
    identified, late = np.asarray(fit.active[12 : 12 + joints], dtype=bool), bool(fit.active[12 + joints])
    notes = () if rms < 3 * noise else (f"views disagree by {1e3 * disagreement:.2f} mm: the limits of the arm",)
    halves = _require_one_place(problem, fit)
    answer = fit.parameters, fit.covariance, identified, late, reasons
    quality = noise, rms, disagreement, scale, scale_sigma, halves
    return HandEyeCalibration(link, names, *answer, problem.views, rejected, dropped, *quality, notes)


def _require_agreement(rms: float, noise: float, size: float) -> float:
    """m that views have the board from each other, of a rms and a noise in pixels of `size` m at the board.

    Raises:
        NoAnswerError: POOR_FIT when it is too much.
    """
    disagreement = float(np.sqrt(max(rms**2 - noise**2, 0.0)) * size)
    if disagreement > _FAR:
        raise NoAnswerError(
            ErrorCode.POOR_FIT,
            f"calibrate: views have the board {1e3 * disagreement:.1f} mm from each other (noise of the corners"
            f" {noise:.2f} pixels): the board moved, the clocks differ, or robot_description is not this robot's",
        )
    return disagreement


def _sound(sightings: Sequence[Sighting], camera: Camera) -> tuple[list[Sighting], list[Pose], float, int]:
    """Views with enough corners, without outliers, the board in each, the noise, pixels, and the number of outliers."""
    rich = [each for each in sightings if show_a_plane(each.corners)]
    if not rich:
        raise InputError(
            ErrorCode.EMPTY,
            f"calibrate: the board was seen in none of {len(sightings)} images ({LEAST_CORNERS} corners or more, not on"
            " one line): check"
            " its kind and dictionary, light and focus",
        )
    if len(rich) < LEAST_VIEWS:
        raise NoAnswerError(
            ErrorCode.TOO_FEW_SAMPLES, f"calibrate: the board was seen in {len(rich)} images; {LEAST_VIEWS} are needed"
        )
    first = [board_pose(each, camera) for each in rich]
    left = np.concatenate([errors.ravel() for _, errors in first])
    limit = max(_CORNER * 1.4826 * float(np.median(np.abs(left))), _CORNER_LEAST)
    sound, poses, ends, dropped = [], [], [], 0
    for each, (pose, errors) in zip(rich, first, strict=True):
        good = np.linalg.norm(errors, axis=1) < limit
        dropped += int(np.sum(~good))
        if show_a_plane(each.corners[good]):
            kept = replace(each, corners=each.corners[good], pixels=each.pixels[good])
            pose, errors = (pose, errors) if good.all() else board_pose(kept, camera)
            sound.append(kept)
            poses.append(pose)
            ends.append(errors.ravel())
    if len(sound) < LEAST_VIEWS:
        what = f"calibrate: corners agree with a flat board in {len(sound)} of {len(rich)} images: is it flat"
        raise NoAnswerError(ErrorCode.POOR_FIT, what)
    free = np.concatenate(ends)
    spent = 1 - 6 * len(sound) / len(free)
    return sound, poses, float(np.sqrt(np.mean(free**2) / spent)), dropped


def _start(links: Pose, boards: list[Pose], joints: int) -> Parameters:
    """Closed form of all views, then of those that fit best.

    Raises:
        NoAnswerError: POOR_FIT when they do not fit at all.
    """
    kept = np.arange(len(boards))
    seen = Pose(np.array([each.rotation for each in boards]), np.array([each.translation for each in boards]))
    for share in (1.0, 0.7, 0.7):
        chosen = Pose(links.rotation[kept], links.translation[kept])
        eye, board = closed_form(chosen, Pose(seen.rotation[kept], seen.translation[kept]))
        off = (links @ eye @ seen).translation - board.translation
        apart = np.linalg.norm(off - np.median(off, axis=0), axis=1)
        kept = np.argsort(apart)[: max(int(share * len(boards)), 4)]
    if np.median(apart) > _NOT_THIS_ROBOT:
        raise NoAnswerError(
            ErrorCode.POOR_FIT,
            f"calibrate: views have the board {np.median(apart):.2f} m from each other: robot_description is not this"
            " robot's, the camera is on another link, or the clocks differ",
        )
    return Parameters(eye, board, np.zeros(joints))


def _fitted(
    kinematics: CameraCarrier,
    camera: Camera,
    seen: list[Sighting],
    start: Parameters,
    options: HandEyeOptions,
    cancelled: Cancelled,
) -> tuple[BoardFit, Mask, dict[str, str]]:
    """The fit without outliers, over what can be identified; which views it has, and why others are not."""
    kept = np.ones(len(seen), dtype=bool)
    problem = BoardProblem(kinematics, camera, seen)
    base = np.zeros(problem.size, dtype=bool)
    base[:12] = True
    fit = adjust(problem, start, base, robust=True)
    for number in range(_ROUNDS):
        problem = BoardProblem(kinematics, camera, [each for each, keep in zip(seen, kept, strict=True) if keep])
        fit = adjust(problem, fit.parameters, base, robust=number == 0)
        active, reasons = _separable(problem, fit, kinematics.joint_names, options)
        fit = _reduced(problem, fit, active, reasons, kinematics.joint_names, not number)
        if cancelled():
            raise NoAnswerError(ErrorCode.CANCELLED, "calibrate: cancelled")
        everything = BoardProblem(kinematics, camera, seen)
        squares = np.bincount(everything.of_view, everything.errors(fit.parameters) ** 2, everything.views)
        rms = np.sqrt(squares / np.bincount(everything.of_view))
        now = rms < _VIEW * np.median(rms[kept])
        if number == _ROUNDS - 1 or np.array_equal(now, kept) or now.sum() < LEAST_VIEWS:
            break
        kept = now
    return fit, kept, reasons


def _reduced(
    problem: BoardProblem, fit: BoardFit, active: Mask, reasons: dict[str, str], names: tuple[str, ...], robust: bool
) -> BoardFit:
    """The fit of what can be identified: the worst offset is left out until all are known well enough.

    What is left out may be wrong by as much as it may be: the covariance of the others has that.
    """
    joints = len(names)
    considered = np.zeros(problem.size)
    limits = np.array([np.inf] * 12 + [_OFFSET] * joints + [_DELAY, np.inf])
    start = replace(fit.parameters, offsets=np.zeros(joints), delay=0.0)
    while True:
        fit = adjust(problem, start, active, considered, robust)
        excess = np.where(active, fit.sigma / limits, 0.0)
        worst = int(np.argmax(excess))
        if not excess[worst] > 1:
            return fit
        active[worst], considered[worst] = False, limits[worst]
        name = "camera_delay" if worst == 12 + joints else names[worst - 12]
        reasons[name] = f"sigma {fit.sigma[worst]:.2g}: the views do not show it; turn and tilt more"


def _separable(
    problem: BoardProblem, fit: BoardFit, names: tuple[str, ...], options: HandEyeOptions
) -> tuple[Mask, dict[str, str]]:
    """Which parameters are not a motion of the camera or the board in disguise; why others are."""
    slopes = problem.slopes(fit.parameters)
    active = np.zeros(problem.size, dtype=bool)
    active[:12] = True
    reasons: dict[str, str] = {}
    wanted = [(12 + k, name) for k, name in enumerate(names) if options.offsets]
    wanted += [(12 + len(names), "camera_delay")] if options.delay else []
    for column, name in wanted:
        before = slopes[:, np.flatnonzero(active)]
        unit = np.linalg.norm(before, axis=0)
        effect = slopes[:, column]
        size = np.linalg.norm(effect)
        left = effect - before / unit @ np.linalg.lstsq(before / unit, effect, rcond=None)[0]
        if size < 1e-9 or np.linalg.norm(left) < _SAME * size:
            moved = (
                "the arm stands still at the images" if name == "camera_delay" else "it is part of hand_eye or board"
            )
            reasons[name] = f"not separable: {moved}"
        else:
            active[column] = True
    return active, reasons


def _require_size(problem: BoardProblem, fit: BoardFit) -> tuple[float, float]:
    """The size of the board through the stated one, and its sigma.

    Raises:
        InputError: BAD_INPUT when it is another.
    """
    active = fit.active.copy()
    active[-1] = True
    free = adjust(problem, fit.parameters, active)
    scale, sigma = free.parameters.scale, float(free.sigma[-1])
    if abs(scale - 1) > max(_SCALE, 4 * sigma):
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"calibrate: the board is {scale:.3f} +- {sigma:.3f} times as large as stated, as the motion of the arm"
            " shows: measure its squares and give their size",
            scale=scale,
        )
    return scale, sigma


def _require_one_place(problem: BoardProblem, fit: BoardFit) -> float:
    """The probability of as large a motion of the board between the halves, by chance.

    One step of Gauss-Newton over all parameters and a second place of the board.

    Raises:
        NoAnswerError: POOR_FIT when it is too small.
    """
    slopes = problem.slopes(fit.parameters)
    later = (problem.of_place >= problem.places // 2)[:, None]
    columns = np.hstack([slopes[:, np.flatnonzero(fit.active)], slopes[:, BOARD] * later])
    unit = np.linalg.norm(columns, axis=0)
    steps = -np.linalg.lstsq(columns / unit, fit.errors, rcond=None)[0] / unit
    spread = jackknife(columns, fit.errors + columns @ steps, problem)[-6:, -6:]
    step, free = steps[-6:], max(problem.places - 7, 1)
    # Hotelling's T squared of 6 numbers; `fdtrc` is `scipy.stats.f.sf` without the import of every distribution.
    size = float(step @ np.linalg.solve(spread, step)) * free / (6 * (free + 5))
    chance = float(fdtrc(6, free, size))
    if chance < _CHANCE:
        raise NoAnswerError(
            ErrorCode.POOR_FIT,
            f"calibrate: the two halves have the board {1e3 * np.linalg.norm(step[3:]):.2f} mm and"
            f" {np.degrees(np.linalg.norm(step[:3])):.2f} deg from each other (chance {chance:.1g}): it slipped, or a"
            " joint's zero changed; fasten it and record again",
        )
    return chance

"""The motion that discriminates between two explanations: a designed excitation for an ambiguous diagnosis.

Two hypotheses A and B explain the recording equally well. Along another motion, the wrench that A predicts is fitted by
B together with the calibration errors, and vice versa: half the remaining whitened square is the expected log evidence
of this motion. The first motion of a family, gentle ones first, that brings enough is chosen.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from poise.mismatch.answer.named import NamedEffect
from poise.mismatch.answer.signal_diagnosis import SignalDiagnosis
from poise.mismatch.effects import Effect, effect_named
from poise.mismatch.inference import FittedEffect, Problem, linearization_point, refine
from poise.mismatch.reading import recorded_from_motion
from poise.mismatch.recorded import RecordedMotion
from poise.robot import RobotModel
from poise.simulation import FourierTrajectory

_RATE = 100.0
"""Hz of the wrench along a designed motion."""
_DURATION = 14.0
"""s of it."""
_ENOUGH = 25.0
"""log evidence that decides between two hypotheses in spite of noise."""
_VIGOUR = ((0.15, 0.4, 0.08, 3), (0.25, 0.8, 0.08, 5), (0.3, 0.3, 0.3, 4), (0.4, 1.2, 0.12, 5), (0.6, 0.6, 0.4, 5))
"""Shares of the speed limits, amplitudes (rad), lowest frequencies (Hz) and harmonics of motions, gentle ones first."""
_TRIES = 4
"""Motions of each kind."""
_MOST_RIVALS = 3
_STEPS = 6
"""Steps of the fits along a motion."""


@dataclass(frozen=True, eq=False)
class DiscriminatingMotion:
    """A motion that discriminates between explanations.

    Args:
        names: the effect of the answer, then its rivals.
        joint_names: (J) of the trajectory.
        trajectory: of all the robot's joints; a mobile base stands.
        expected: expected log evidence of the true effect against its closest rival.
    """

    names: tuple[str, ...]
    joint_names: tuple[str, ...]
    trajectory: FourierTrajectory
    expected: float

    @property
    def enough(self) -> bool:
        """Whether the expected evidence decides."""
        return self.expected >= _ENOUGH


def design_motion(
    examined: SignalDiagnosis, robot: RobotModel, seed: int = 0, progress: Callable[[float], None] = lambda share: None
) -> DiscriminatingMotion | None:
    """Design the motion that resolves an ambiguous diagnosis; None when it is not ambiguous.

    Args:
        examined: the wrench of a recording.
        robot: of the recording; the motion starts from the middle of the recorded one.
        seed: equal seeds give equal motions.
        progress: is called with the completed share of the work.
    """
    asked = _open_question(examined)
    if asked is None:
        return None
    finding, rivals = asked
    others = tuple(part for part in examined.best.parts if part.effect.name != finding.effect.name)
    first = FittedEffect(finding.effect, finding.values)
    fitted = [_fitted(examined, others, rival) for rival in rivals]
    best: DiscriminatingMotion | None = None
    names = (finding.effect.name, *(rival.name for rival in rivals))
    motions = list(_motions(examined.problem.recorded, robot, np.random.default_rng(seed)))
    for number, trajectory in enumerate(motions):
        along = _world(examined.problem.recorded, robot, trajectory)
        expected = min(distance(examined.problem, along, others, first, rival) for rival in fitted)
        if best is None or expected > best.expected:
            best = DiscriminatingMotion(names, robot.joint_names, trajectory, expected)
        progress((number + 1) / len(motions))
        if best.enough:
            break
    progress(1.0)
    return best


def distance(
    problem: Problem, along: RecordedMotion, others: tuple[FittedEffect, ...], first: FittedEffect, second: FittedEffect
) -> float:
    """Expected log evidence between two parts along a motion, the lesser of both directions.

    Args:
        problem: of the recording: tolerances and noise.
        along: the motion with the nominal prediction.
        others: further effects.
        first, second: with their values on the recording.
    """
    return min(_missed(problem, along, others, first, second), _missed(problem, along, others, second, first))


def _missed(
    problem: Problem, along: RecordedMotion, others: tuple[FittedEffect, ...], true: FittedEffect, rival: FittedEffect
) -> float:
    """Residual of the rival for the response of the true part, beyond that of the true part itself."""
    noise = replace(problem.noise, seconds=along.seconds, speed=along.speed, motion=None)
    blank = Problem(along, problem.model, noise)
    read = blank.compose([*others, true])[1].prediction
    made = replace(blank, recorded=replace(along, wrench=read))
    here = linearization_point(made, others)
    explained = []
    for part in (true, rival):
        starts = [part.values, *part.effect.starts(here.recorded, here.residual)]
        fits = [refine(made, here.regression, here.recorded, part.effect, start, _STEPS) for start in starts[:3]]
        explained.append(max(each.drop for each in fits))
    return 0.5 * (explained[0] - explained[1])


def _open_question(examined: SignalDiagnosis) -> tuple[NamedEffect, list[Effect]] | None:
    """The likeliest finding with indistinguishable rivals; events do not recur in another motion."""
    for finding in examined.findings if examined.problem.signal == "wrench" else ():
        rivals = [effect for name in finding.belief.alike if (effect := effect_named(name)) and effect.transfers]
        if rivals and finding.effect.transfers:
            return finding, rivals[:_MOST_RIVALS]
    return None


def _fitted(examined: SignalDiagnosis, others: tuple[FittedEffect, ...], rival: Effect) -> FittedEffect:
    """A rival as it explains the recording best."""
    wanted = tuple(sorted([*(part.effect.name for part in others), rival.name]))
    known = examined.search.fits.get(wanted)
    if known is None:
        here = linearization_point(examined.problem, others)
        tried = [
            refine(examined.problem, here.regression, here.recorded, rival, start, _STEPS)
            for start in rival.starts(here.recorded, here.residual)
        ]
        best = max(tried, key=lambda each: each.drop)
        return FittedEffect(rival, best.values)
    return next(part for part in known.parts if part.effect.name == rival.name)


def _motions(recorded: RecordedMotion, robot: RobotModel, rng: np.random.Generator) -> Iterator[FourierTrajectory]:
    """Fourier series about the middle of the recorded motion, and about places near it, gentle ones first."""
    middle = np.zeros(len(robot.joint_names))
    if recorded.joints is not None:
        for name, values in zip(recorded.joints.names, recorded.joints.position.T, strict=True):
            middle[robot.joint_names.index(name)] = float(np.clip(np.median(values), -1e3, 1e3))
    still = robot.base_joints
    inside = np.where(np.isfinite(robot.lower), 0.1 * (robot.upper - robot.lower), 0.0)
    inside = np.nan_to_num(inside, posinf=0.0)
    for speed, amplitude, frequency, harmonics in _VIGOUR:
        for number in range(_TRIES):
            shift = rng.uniform(-0.5, 0.5, len(middle)) * (number > 0) * (np.arange(len(middle)) >= still)
            centre = np.clip(middle + shift, robot.lower + inside, robot.upper - inside)
            made = FourierTrajectory.random(
                robot,
                rng,
                duration=_DURATION,
                speed=speed,
                amplitude=amplitude,
                frequency=frequency,
                harmonics=harmonics,
                centre=centre,
            )
            moves = np.arange(len(middle)) >= still
            yield replace(made, sine=made.sine * moves, cosine=made.cosine * moves)


def _world(recorded: RecordedMotion, robot: RobotModel, trajectory: FourierTrajectory) -> RecordedMotion:
    """The motion with the nominal prediction, the base at rest."""
    seconds = np.arange(int(_DURATION * _RATE) + 1) / _RATE
    gravity = float(np.linalg.norm(recorded.gravity[0]))
    return recorded_from_motion(robot, seconds, trajectory.at(seconds), recorded.phi, gravity=gravity)

"""Backlash: the gear has play between motor and link."""

import itertools
from collections.abc import Iterable, Sequence
from functools import cache
from operator import itemgetter
from typing import ClassVar

import numpy as np
from scipy.ndimage import uniform_filter1d

from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.joint_friction import column_of, efforts, joint_called, joint_unit, numbers, slides
from poise.mismatch.effects.knocks import knocks_at
from poise.mismatch.effects.stops import between_stops
from poise.mismatch.recorded import RecordedMotion, white_level
from poise.types import Array

_LOUD, _KNOCK = 1.1, 6.0
"""Residual (rms, and its largest sample) in units of white noise from which a joint is examined."""
_GAPS, _SLIDING = (3e-5, float(np.radians(3.5))), (1e-5, 5e-3)
"""rad and m: a gear with less play shows none, and one with more is broken."""
_TURNED = 0.3
"""rad by which the lever of the weight may be turned about the joint: tolerances of the load and of the encoder."""
_AT_END = 1.01
"""Times the smallest gap up to which a fit was stopped there: a smaller one explains as much, and shows nothing."""
_TRIED = 17
"""Gaps that are tried."""
_JOINTS, _LEAST_SCORE = 2, 0.2
"""Joints whose gap is searched finely, and from which score in units of the best: knocks shake other joints too."""
_SOFT = (0.003, 0.006, 0.01, 0.02)
"""s in which a knock settles."""
_BLURS, _FINE = (15, 5), 9
_SEARCHES = ((15, 0.7, 0.24), (5, 0.15, 0.06), (1, 0.06, 0.02))
"""Width of the blur in samples; how far, as a logarithm, the best gap so far is varied, and how far the lever turns."""
_CROSSED = 1
"""Samples inside the gap at a usual crossing, from more than which these show it."""
_MOST = 2.0
"""Of the effort of a free link that the fit may have: it is 1 for an exact inertia; more than vanishes is no gap."""


class Backlash(Effect):
    """The link of one joint is free within a gap: no effort while it crosses, and a knock where it arrives.

    Encoder and effort are the motor's. With e the link's angle beyond the motor's: e'' = -tau_j / M_jj when free;
    for any e(t) the efforts change by M e'' and by dtau/dq e.
    """

    name = "backlash"
    layer = "friction"
    knocks = True
    signal = "effort"
    equation = "dtau = M_.j e'' + (dtau/dq_j) e; e'' = -tau_j / M_jj while |e| < gap / 2; flanks push as damped springs"
    source = "dead zone with impacts (Nordin and Gutman 2002, section 2); M: joint-space inertia"
    excited_by = "a joint whose torque changes sign: a vertical axis that speeds up and slows down, a balanced wrist"
    separating_motion = "small strokes of the joint to and fro without load: the torque vanishes, then knocks"
    confused_with = ("coulomb_friction", "stribeck_friction", "motor_inertia")
    needs = ("effort",)
    defaults: ClassVar[Values] = {"own_knock": 0.0, "others_knock": 0.0, "turned": 0.0}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        if recorded.effort is None:
            return ()
        ranges = [_gaps(recorded, number) for number in numbers(recorded)]
        low, high = min(each[0] for each in ranges), max(each[1] for each in ranges)
        return (
            EffectParameter("joint", "", low=1.0, high=float(max(numbers(recorded))), linear=False, choice=True),
            EffectParameter("gap", "rad", low=low, high=high, linear=False, log=True, law_error=0.05),
            EffectParameter("turned", "rad", low=-_TURNED, high=_TURNED, linear=False, hidden=True),
            EffectParameter("settling", "s", low=5e-4, high=0.1, linear=False, log=True, hidden=True),
            EffectParameter("own", "", 1.0, high=_MOST, positive=True, hidden=True),
            EffectParameter("others", "", 1.0, hidden=True),
            EffectParameter("own_knock", "", 1.0, hidden=True),
            EffectParameter("others_knock", "", 1.0, hidden=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The joints whose gap explains most; gap, lever and softness of the knock, from coarse to fine blur.

        A knock some samples too late explains nothing; in a blurred residual its gap still leads to a better one.
        """
        level = np.maximum(white_level(residual), 1e-12)
        loud = np.maximum(residual.std(axis=0) / _LOUD, np.abs(residual).max(axis=0) / _KNOCK) >= level

        @cache
        def left(column: int, blur: int) -> Array:
            return _blurred(residual[:, column] / level[column], blur)

        def explained(values: Values, blurs: Sequence[int]) -> float:
            column = column_of(recorded, values["joint"])
            response = self.columns(recorded, values)[:, column, 0]
            return max(_explained(left(column, blur), _blurred(response, blur)) for blur in blurs)

        def best(tried: Iterable[Values], *blurs: int) -> tuple[float, Values]:
            return max(((explained(values, blurs), values) for values in tried), key=itemgetter(0))

        coarse = [
            best((_values(joint, gap) for gap in np.geomspace(*_gaps(recorded, joint), _TRIED).tolist()), *_BLURS)
            for joint in np.asarray(numbers(recorded), dtype=float)[loud].tolist()
        ]
        coarse.sort(key=itemgetter(0), reverse=True)
        for at in [values for score, values in coarse[:_JOINTS] if score >= _LEAST_SCORE * coarse[0][0]]:
            for blur, reach, turn in _SEARCHES:
                at = best(_near(at, reach, turn, _gaps(recorded, at["joint"])), blur)[1]
            yield best([{**at, "settling": settling} for settling in _SOFT], 1)[1]

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        """The effort of the joint itself, and of the others: less where these yield; and what knocks add to both.

        How hard a knock is depends on the rotor, which recoils between two samples.
        """
        track, column = efforts(recorded), column_of(recorded, nonlinear["joint"])
        push, (beyond, _, second) = _free_link(recorded, nonlinear)
        inertia = track.by_acceleration[:, :, column]
        knock = second - push * (np.abs(beyond) < 0.5 * nonlinear["gap"])
        whole = inertia * second[:, None] + track.by_position[:, :, column] * beyond[:, None]
        own = np.arange(whole.shape[1]) == column
        knocks = inertia * knock[:, None]
        return np.stack([whole * own, whole * ~own, knocks * own, knocks * ~own], axis=2)

    def unsettled(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        """The knocks: when they come depends on the speed at which a small torque changes its sign."""
        push, (beyond, speed, _) = _free_link(recorded, values)
        return knocks_at(efforts(recorded).seconds, beyond, speed, push, values["gap"], values["settling"])

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        low, high = _gaps(recorded, values["joint"])
        inside = low * _AT_END < values["gap"] <= high * (1.0 + 1e-9)
        wrong = "" if inside else f"gap would be {values['gap']:.3g} {joint_unit(recorded, 'rad', 'gap', values)}"
        return super().implausible(recorded, values) or wrong or _unseen(recorded, values)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        sliding = slides(recorded, values["joint"])
        gap = f"{1e3 * values['gap']:.2g} mm" if sliding else f"{np.degrees(values['gap']):.2f} degrees"
        return (
            f"{joint_called(recorded, values['joint'])} has {gap} of backlash: its {'force' if sliding else 'torque'} "
            "vanishes at each change of sign, then a knock follows; the nominal gear has no play."
        )


def _free_link(recorded: RecordedMotion, values: Values) -> tuple[Array, tuple[Array, Array, Array]]:
    """(M,) acceleration of a free link relative to its motor; and how it moves in the gap, see `between_stops`."""
    track, column = efforts(recorded), column_of(recorded, values["joint"])
    torque = track.rigid[:, column] + values["turned"] * track.by_position[:, column, column]
    push = np.asarray(-torque / np.maximum(track.by_acceleration[:, column, column], 1e-6))
    return push, between_stops(track.seconds, push, values["gap"], values["settling"])


def _unseen(recorded: RecordedMotion, values: Values) -> str:
    """Why no sample would show the link inside the gap: a knock alone may be a corner of the motion."""
    _, (beyond, *_) = _free_link(recorded, values)
    stopped = np.flatnonzero(np.abs(beyond) >= 0.5 * values["gap"])
    crossed = np.diff(stopped)[np.diff(np.sign(beyond[stopped])) != 0.0] - 1
    seen = not crossed.size or np.median(crossed) > _CROSSED
    return "" if seen else "the gap would be crossed from one sample to the next"


def _blurred(values: Array, blur: int) -> Array:
    """(M,) averages over a number of samples, less their mean."""
    blurred = uniform_filter1d(values, blur)
    return np.asarray(blurred - blurred.mean())


def _explained(residual: Array, response: Array) -> float:
    """How much of the sum of squares of a residual (M,) a response (M,) explains."""
    return max(float(residual @ response), 0.0) ** 2 / max(float(response @ response), 1e-12)


def _values(joint: float, gap: float) -> Values:
    """Nominal torque, and knocks of medium softness."""
    return {"joint": joint, "gap": gap, "settling": _SOFT[1], "turned": 0.0}


def _near(at: Values, reach: float, turn: float, gaps: tuple[float, float]) -> list[Values]:
    """Other gaps, in a range, and angles of the lever."""
    near = (at["gap"] * np.exp(np.linspace(-reach, reach, _FINE))).tolist()
    turned = np.clip(at["turned"] + np.linspace(-turn, turn, _FINE), -_TURNED, _TURNED).tolist()
    tried = itertools.product((gap for gap in near if gaps[0] <= gap <= gaps[1]), turned)
    return [{**at, "gap": gap, "turned": angle} for gap, angle in tried]


def _gaps(recorded: RecordedMotion, joint: float) -> tuple[float, float]:
    """The range of gaps of a joint, rad or m."""
    return _SLIDING if slides(recorded, joint) else _GAPS

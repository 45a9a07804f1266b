"""Loose part: a part of the payload slides between two stops and knocks against them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.ndimage import uniform_filter1d

from poise.geometry import cross, lengths, sphere_directions
from poise.mismatch.effects.base import Effect, EffectParameter, Values, values_at
from poise.mismatch.effects.knocks import Knocks, find_knocks, knocks_at
from poise.mismatch.effects.part_wrench import (
    AXIS_PARAMETERS,
    PAYLOAD_REACH,
    POINT_PARAMETERS,
    chart,
    direction,
    likely_place,
    named_axis,
    no_part,
    payload_centre,
    place_of,
    sliding_wrench,
    specific_at,
)
from poise.mismatch.effects.starts import noise_in
from poise.mismatch.effects.stops import BLUR, between_stops, travelled
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_COARSE = 0.02
"""s over which readings are averaged in the first stages of a search, and where it begins."""
_STAGES, _SCREENED = ((_COARSE, 7, 10, 1.0), (_COARSE, 2, 18, 0.6), (0.0, 2, 14, 0.3)), 3
"""Stages of a search: s over which readings are averaged (0: every sample), number of these averages over which
differences are averaged again, generations, and share of the widths about the result of the stage before. Averages that
are averaged again where it begins."""
_WIDTHS, _EDGE = {"gap": 0.05, "settling": 0.2, "axis_a": 0.015, "axis_b": 0.015, "x": 0.05, "friction": 0.15}, 2e-3
"""Half-widths of the search in the places of values in their priors, and the least distance from the ends."""
_STRIDE = 0.05
"""s between the samples that show where the part rests."""
_FEWEST = 2
"""Knocks on the other stop that a part needs, and knocks that a start from knocks needs."""
_AXES, _HEARD = 80, 40.0
"""Axes that are tried for a part without audible knocks; drop of the square from which an axis is examined."""
_FEEBLE, _SILENT = 0.025, 0.05
"""Share of the square of the averaged residual that a start must explain to be improved, with and without audible
knocks: parts of 75 g explain 3 to 10 %, other effects with as loud knocks up to 2 % (benchmarks.concealed)."""
_GAPS, _SETTLING = tuple(np.geomspace(0.003, 0.03, 12).tolist()), 0.01
"""m and s that are tried."""
_SMOOTH, _ROUGH = 1e-3, 1.0
"""Range of the coefficient of friction. The least is none: a part then starts up to 2 ms late."""
_FRICTIONS = (1.5 * _SMOOTH, 0.02, 0.08, 0.25)
"""Coefficients that are tried."""
_TRIED = 2
"""Starts that are improved: each may end at a gap that is right for some of the knocks alone."""
_SURE, _NEAR, _TIMED = 0.02, 0.03, 0.003
"""rad, m and s: accuracy of axis, place and time from knocks alone."""


class LoosePart(Effect):
    """A mass that slides along an axis of the tool between two stops, with dry friction in its guide.

    Its mass is part of the nominal payload, in the middle of the gap: the response is the difference. A stop pushes as
    a critically damped spring and does not pull. The guide presses on the part with what acts across the axis. The
    moments of knocks are known to a millisecond, and a small change of the gap moves them all: the fit is sharp also
    where the stops follow another law. The errors of the law are those of nine parts with other stops.
    """

    name = "loose_part"
    layer = "load"
    fast = True
    knocks = True
    equation = (
        "z'' = n.(g - a_p) - mu |n x (g - a_p)| sign(z'); in a stop at depth d also -max(2 d' / T + d / T^2, 0) "
        "outwards; part at p + n z instead of at p"
    )
    source = "impact pair (Brach 1991, Mechanical Impact Dynamics, chapter 2) with Kelvin and Voigt's stops"
    excited_by = "tilting the axis through the level, and accelerating along it"
    separating_motion = "tilt slowly to and fro about the level: knocks come at the same tilt every time"
    confused_with = ("slosh", "flexible_mode", "contact", "payload_parameters")
    needs = ("load",)

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("gap", "m", low=5e-4, high=0.1, linear=False, log=True, law_error=0.05),
            EffectParameter("settling", "s", low=5e-4, high=0.1, linear=False, log=True, hidden=True),
            EffectParameter("friction", "", low=_SMOOTH, high=_ROUGH, linear=False, log=True, vanishes=True),
            *(
                EffectParameter(name, "", low=-1.9, high=1.9, linear=False, hidden=True, law_error=0.01)
                for name in AXIS_PARAMETERS
            ),
            *(
                EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False, law_error=0.02)
                for name in POINT_PARAMETERS
            ),
            EffectParameter("mass", "kg", 0.4, positive=True, law_error=0.25),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Knocks give the place, the axis and the gap; so does the torque of the part at rest."""
        wanted = residual - residual.mean(axis=0)
        weight = 1.0 / noise_in(recorded, residual)
        readings = find_knocks(recorded.seconds, wanted[:, :3], 1.0 / weight[:3])
        bent = _bent(recorded, residual)
        found = self._from_rest(recorded, bent, weight)
        heard = bool(readings) and len(readings[0].moments) >= _FEWEST
        if heard:
            found += [self._from_knocks(recorded, wanted, knocks) for knocks in readings[:3]]
        if not found:
            return

        # The gap that the knocks say is wrong where some were not heard, and few samples show how a stop settles. A
        # part that rubs knocks as late as one with another gap, so that each friction leads to a valley of its own.
        view = _View.of(recorded, bent, weight, _COARSE, _SCREENED)
        least = max(_HEARD, (_FEEBLE if heard else _SILENT) * view.square)
        tried = [
            max(
                (
                    {**start, "gap": gap, "settling": settling, "friction": friction}
                    for start in found
                    for gap, settling in ((start["gap"], start["settling"]), *((gap, _SETTLING) for gap in _GAPS))
                ),
                key=view.drop,
            )
            for friction in _FRICTIONS
        ]
        stages = [
            (_View.of(recorded, bent, weight, seconds, blur), generations, share)
            for seconds, blur, generations, share in _STAGES
        ]
        roughly = [self._sharpened(one, stages[:1]) for one in tried if view.drop(one) > least]
        for start in sorted(roughly, key=view.drop, reverse=True)[:_TRIED]:
            yield self._sharpened(start, stages[1:])

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        return _part_wrench(recorded, nonlinear)[:, :, None]

    def unsettled(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        """The knocks: while a stop gives way."""
        push, (slid, speed, _) = _slid(recorded, values)
        return knocks_at(recorded.seconds, slid, speed, push, values["gap"], values["settling"])

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        reason = super().implausible(recorded, values) or no_part(recorded, values, values["mass"])
        if reason:
            return reason
        _, (slid, _, _) = _slid(recorded, values)
        stops = np.sign(slid[np.abs(slid) > 0.5 * values["gap"]])
        return "" if np.count_nonzero(np.diff(stops)) >= _FEWEST else "it would hardly leave its stop"

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return named_axis(values)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        return (
            f"{1e3 * values['mass']:.0f} g of the payload are loose: they slide {1e3 * values['gap']:.0f} mm along "
            f"{'xyz'[int(np.argmax(np.abs(direction(values))))]} and knock; the nominal payload is rigid."
        )

    @staticmethod
    def _from_knocks(recorded: RecordedMotion, wanted: Array, knocks: Knocks) -> dict[str, float]:
        """The part that makes these knocks in a residual."""
        struck, twisted = np.diff(wanted[:, :3], axis=0)[knocks.rows], np.diff(wanted[:, 3:], axis=0)[knocks.rows]
        centre = payload_centre(recorded)
        place = centre + likely_place(struck, twisted - cross(centre, struck))
        begin = np.array([*chart(knocks.axis).values(), 0.0, 0.0, *place])
        impulses = knocks.impulses * np.sign(knocks.axis @ _axis(begin))
        sides = np.sign(impulses)
        crossed = np.concatenate([sides[:1], np.diff(sides) / 2.0])

        def course(x: Array) -> tuple[Array, Array]:
            return travelled(recorded.seconds, specific_at(recorded, x[4:]) @ _axis(x), knocks.moments, sides)

        def off(x: Array) -> Array:
            """Distances relative to the gap, in units of half a sample; impulses; prior knowledge."""
            far, speed = course(x)
            distance = (far - np.exp(x[2]) * crossed) / (_TIMED * np.abs(speed) + 1e-4)
            likelier = np.abs(distance).argmin(axis=0), np.arange(len(sides))
            impulse = (impulses / np.exp(x[3]) - speed[likelier]) / (0.1 * np.median(np.abs(speed)) + 1e-3)
            return np.concatenate([distance[likelier], impulse, (x[:2] - begin[:2]) / _SURE, (x[4:] - place) / _NEAR])

        far, speed = np.abs(course(begin))
        begin[2] = np.log(max(float(np.median(far[0, crossed != 0.0])), 1e-4))
        begin[3] = np.log(max(float(np.median(np.abs(impulses))) / max(float(np.median(speed[0])), 1e-3), 1e-3))
        found = scipy.optimize.least_squares(off, begin, loss="soft_l1", diff_step=1e-4, max_nfev=30).x
        gap = float(np.clip(np.exp(found[2]), 6e-4, 0.09))
        place = np.clip(found[4:], -0.9 * PAYLOAD_REACH, 0.9 * PAYLOAD_REACH)
        return _values(gap, knocks.settling, _axis(found), place)

    def _from_rest(self, recorded: RecordedMotion, wanted: Array, weight: Array) -> list[dict[str, float]]:
        """The part whose weight, at one of the stops, explains most of the torque; none when it explains little."""
        centre = payload_centre(recorded)
        # The part changes sides rarely: means of some samples are enough.
        few = max(round(_STRIDE / recorded.period), 1)
        push, basis = specific_at(recorded, centre)[::few], _basis(recorded)[::few] * np.sqrt(few)
        torque = uniform_filter1d(wanted[:, 3:] * weight[3:], few, axis=0)[::few]

        def explained(axis: Array) -> float:
            here = (np.sign(push @ axis) / 2.0)[:, None] * cross(axis, push) * weight[3:]
            here -= basis @ (basis.T @ here)
            along = float(np.sum(here * torque))
            return few * max(along, 0.0) ** 2 / max(float(np.sum(here**2)), 1e-12)

        axis = max(sphere_directions(2 * _AXES)[:_AXES], key=explained)
        for reach in (0.2, 0.08, 0.03):
            axis = max((axis, *_around(axis, reach)), key=explained)
        if explained(axis) < _HEARD:
            return []
        return [_values(_GAPS[0], _SETTLING, axis, centre)]

    def _sharpened(self, start: dict[str, float], stages: Sequence[tuple["_View", int, float]]) -> dict[str, float]:
        """Differential evolution about a start, from coarse to fine blur; see `_STAGES`.

        A knock that is a sample too late explains nothing, so that the square has a valley for each knock.
        """
        moving = [p for p in self.parameters(stages[0][0].recorded) if not p.linear]
        width = np.array([_WIDTHS.get(p.name, _WIDTHS["x"]) for p in moving])

        places = np.array([p.to_unit(start[p.name]) for p in moving])
        for view, generations, share in stages:
            places = np.clip(places, _EDGE, 1.0 - _EDGE)
            around = np.clip([places - share * width, places + share * width], 1e-3, 1.0 - 1e-3).T
            places = scipy.optimize.differential_evolution(
                lambda tried, view=view: -view.drop(values_at(moving, tried)),
                around,
                x0=places,
                popsize=2,
                maxiter=generations,
                init="latinhypercube",  # "sobol" would import scipy.stats: 0.7 s
                tol=0.0,
                polish=False,
                rng=0,
            ).x
        return values_at(moving, places)


@dataclass(frozen=True)
class _View:
    """A residual as a stage of the search looks at it: weighed averages of averages.

    Args:
        recorded: the samples in the middle of the first averages; weight: (6,) of those.
        half: s, half the time of a first average.
        blur: number of first averages in one of the second.
        there: the second averages, flat.
    """

    recorded: RecordedMotion
    weight: Array
    half: float
    blur: int
    there: Array

    @classmethod
    def of(cls, recorded: RecordedMotion, residual: Array, weight: Array, seconds: float, blur: int) -> "_View":
        """A residual (N, 6), averaged over some time and then `blur` times that."""
        few, half = max(round(seconds / recorded.period), 1), BLUR
        if few > 1:
            count, half = len(recorded) // few, few * recorded.period / 2
            middle = np.zeros(len(recorded), dtype=bool)
            middle[few // 2 : few * count : few] = True
            residual = residual[: few * count].reshape(count, few, -1).mean(axis=1)
            whole, weight = recorded, weight * np.sqrt(few)
            recorded = whole.once(f"one of {few} samples", lambda: whole.select(middle))
        return cls(recorded, weight, half, blur, _blurred(residual, weight, blur))

    @property
    def square(self) -> float:
        """Of the residual."""
        return _step(self.blur) * float(self.there @ self.there)

    def drop(self, values: Values) -> float:
        """By how much the best mass of a part lowers the square of the residual."""
        wrench = _part_wrench(self.recorded, values, self.half)
        here = _blurred(_bent(self.recorded, wrench), self.weight, self.blur)
        along = max(float(here @ self.there), 0.0)
        return _step(self.blur) * along**2 / max(float(here @ here), 1e-12)


def _part_wrench(recorded: RecordedMotion, values: Values, blur: float = BLUR) -> Array:
    """(N, 6) of 1 kg that slides, beside this mass in the middle; see `between_stops` for `blur`."""
    _, slid = _slid(recorded, values, blur)
    return sliding_wrench(recorded, place_of(values), direction(values), slid)


def _slid(recorded: RecordedMotion, values: Values, blur: float = BLUR) -> tuple[Array, tuple[Array, Array, Array]]:
    """(N,) m/s2 along the axis of a free part; and its place along the axis, m, rate and second rate."""
    felt, axis = specific_at(recorded, place_of(values)), direction(values)
    push = felt @ axis
    drag = values["friction"] * lengths(felt - push[:, None] * axis)
    return push, between_stops(recorded.seconds, push, values["gap"], values["settling"], drag, blur)


def _blurred(values: Array, weight: Array, blur: int) -> Array:
    """Weighed wrenches (N, 6) without their mean, averaged over some samples, flat."""
    return np.asarray(uniform_filter1d((values - values.mean(axis=0)) * weight, blur, axis=0)[:: _step(blur)].ravel())


def _values(gap: float, settling: float, axis: Array, place: Array) -> dict[str, float]:
    point = dict(zip(POINT_PARAMETERS, place.tolist(), strict=True))
    return {"gap": gap, "settling": settling, "friction": _SMOOTH, **chart(axis), **point}


def _step(blur: int) -> int:
    """Samples between averages of `blur` samples."""
    return max(blur // 2, 1)


def _bent(recorded: RecordedMotion, values: Array) -> Array:
    """(N, 6) without the part that a bias or a shifted centre of mass would explain."""
    basis = _basis(recorded)
    return np.asarray(values - basis @ (basis.T @ values))


def _basis(recorded: RecordedMotion) -> Array:
    """(N, 4) orthonormal columns: a constant, and what a shifted centre of mass adds."""

    def made() -> Array:
        return np.asarray(np.linalg.qr(np.hstack([np.ones((len(recorded), 1)), recorded.specific]))[0])

    return recorded.once("constant and specific force", made)


def _around(axis: Array, reach: float) -> Array:
    """(8, 3) unit vectors at a distance (rad) around one."""
    across = np.linalg.svd(axis[None])[2][1:]
    turn = np.arange(8) * np.pi / 4.0
    moved = axis + reach * (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1])
    return np.asarray(moved / np.linalg.norm(moved, axis=1, keepdims=True))


def _axis(x: Array) -> Array:
    return direction(dict(zip(AXIS_PARAMETERS, x[:2].tolist(), strict=True)))

"""Contact: for a while something pushes on the tool, with or without sliding.

It has two laws. A plate pushes by the depth of the tool inside it: few numbers say when, how and again. Anything else
pushes in a window, in a course that is free.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar

import numpy as np

from poise.geometry import applied, cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.plate import (
    PLATE,
    PUSHES,
    depth_inside,
    friction,
    inward,
    no_plate,
    peak_on_plate,
    plate_parameters,
    plate_starts,
    plate_wrenches,
    touches,
)
from poise.mismatch.effects.starts import bursts, chained
from poise.mismatch.recorded import RecordedMotion, directed, forces_at
from poise.types import Array

_POINT = ("x", "y", "z")
_FREE, _PLATE = 0.0, 1.0
"""The laws."""
_NO_PLATE = dict.fromkeys(PLATE, 0.0) | {"law": _FREE, "exponent": 1.5}
_FEWEST, _MOST, _SPACING = 7, 15, 0.15
"""Knots of the force's course; s between them from which a long contact has more than the fewest."""
_OF_WINDOW = ("start", "length", "knots", *(f"force_{axis}_{k}" for k in range(_MOST) for axis in "xyz"))
"""Parameters of a contact with a free course."""
_REACH = 0.5
_ENOUGH = 100
"""Samples outside a contact that suffice to fit the rest of the recording."""
_AROUND = 0.3
"""s before and after a burst that the search for its window includes at least."""
_PULL = 0.4
"""Largest force against the push, relative to it: calibration errors and noise may seem to pull a little."""
_GIVEN = 0.2
"""Share of the work of a contact that it may have given to the tool before it took as much: errors of the force."""
_KEPT = 0.4
"""Share of its work that a field may keep or lose in a fit: a conservative force returns what it gives."""
_SHORTEST = 0.05
"""s of a touch."""
_NARROWER = tuple(np.linspace(-0.06, 0.4, 24).tolist())
"""Shares of a burst by which its window may begin later and end earlier."""
_CHAINED = 0.5
"""s between bursts that may be those of one contact."""
_MOVES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1))
"""Steps of start and end that are tried."""


class PlateContact(Effect):
    """A force in the world at a point of the tool: of a plate, or from `start` for `length` as a linear B-spline.

    The course contains the normal force and the friction: friction is the component against the sliding.
    """

    name = "contact"
    layer = "event"
    equation = (
        "tau = p x f; of a plate f = -(d / 1 cm)^e R^T ((P + S + D d' / (0.1 m/s)) n + S v/|v|) for depths d > 0; else "
        "f = R^T sum_k h_k(t) F_k, h_k: hat functions, zero at both ends of the window"
    )
    source = "Hunt and Crossley 1975 with Coulomb friction; a unilateral contact described by the course of its force"
    excited_by = "nothing: it happens"
    separating_motion = "repeat the motion without the obstacle; press again at another attitude"
    confused_with = ("mass_step", "external_vibration", "loose_part", "cable")
    transfers = False
    free_course = True
    defaults: ClassVar[Values] = {"force_": 0.0, "knots": float(_FEWEST), **_NO_PLATE}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        first, last = float(recorded.seconds[0]), float(recorded.seconds[-1])
        when = (
            EffectParameter("start", "s", low=first - 1.0, high=last, linear=False),
            EffectParameter("length", "s", low=0.03, high=max(recorded.duration / 2, 1.0), linear=False, log=True),
        )
        points = (EffectParameter(name, "m", low=-_REACH, high=_REACH, linear=False) for name in _POINT)
        knots = EffectParameter("knots", "", low=_FEWEST, high=_MOST, linear=False, choice=True, hidden=True)
        forces = (EffectParameter(f"force_{a}_{k}", "N", 5.0, hidden=True) for k in range(_MOST) for a in "xyz")
        law = EffectParameter("law", "", low=_FREE, high=_PLATE, linear=False, choice=True, hidden=True)
        return (*when, *points, law, knots, *forces, *plate_parameters())

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Bursts of the residual; in each, the point from torque = p x force, then the window that fits best."""
        found = list(bursts(recorded, residual))
        # Where the calibration follows a part of a long contact, two bursts are left of it.
        whole = {chained(found, found[0], _CHAINED)} - set(found) if found else set()
        for begin, end in (*found, *whole):
            straight = _straight(recorded, residual, begin, end)
            inside = (recorded.seconds >= begin) & (recorded.seconds <= end)
            force, torque = straight[inside, :3], straight[inside, 3:]
            lever = np.stack([cross(unit, force) for unit in np.eye(3)], axis=2)
            normal = np.einsum("nci,ncj->ij", lever, lever)
            normal += (0.02 * np.trace(normal) + 1e-9) / 3 * np.eye(3)
            point = np.linalg.solve(normal, np.einsum("nci,nc->i", lever, torque))
            place = dict(zip(_POINT, np.clip(point, -0.9 * _REACH, 0.9 * _REACH).tolist(), strict=True))
            inner = [each for each in bursts(recorded, straight) if begin <= each[0] and each[1] <= end]
            start, stop = self._window(recorded, straight, [(begin, end), *inner[:1]])
            length = float(np.clip(stop - start, _SHORTEST, recorded.duration / 3))
            for knots in sorted({_FEWEST, int(np.clip(round(length / _SPACING), _FEWEST, _MOST))}):
                yield {**_NO_PLATE, "start": start, "length": length, "knots": float(knots), **place}
        for plate in plate_starts(recorded, residual):
            yield {"start": 0.0, "length": 1.0, "knots": float(_FEWEST), "law": _PLATE, **plate}

    @staticmethod
    def _window(recorded: RecordedMotion, residual: Array, seen: Sequence[tuple[float, float]]) -> tuple[float, float]:
        """The window with the least residual force in world axes: many windows around the bursts are tried.

        The optima are narrow and close together, as knots meet bends of the course; a descent stops at the nearest.
        """
        begin, end = seen[0]
        around = max(0.5 * (end - begin), _AROUND)
        rows = (recorded.seconds > begin - around) & (recorded.seconds < end + around)
        seconds, force = recorded.seconds[rows], recorded.to_world(residual[:, :3])[rows]
        # Beside a cubic: other errors, and the effect of the contact on the calibration, change slowly.
        slow = np.linalg.qr(np.vander(seconds - seconds.mean(), 4))[0]
        force = force - slow @ (slow.T @ force)

        def left(window: tuple[float, float]) -> float:
            if window[1] - window[0] < _SHORTEST:
                return np.inf
            linear_bspline_basis = _hats(seconds, window[0], window[1] - window[0], _FEWEST)
            linear_bspline_basis = linear_bspline_basis - slow @ (slow.T @ linear_bspline_basis)
            normal = linear_bspline_basis.T @ linear_bspline_basis
            right = linear_bspline_basis.T @ force
            ridge = 1e-6 * float(np.trace(normal)) + 1e-12  # a window may lie where there are no samples
            solved = np.linalg.solve(normal + ridge * np.eye(_FEWEST), right)
            return -float(np.sum(solved * right))

        found = []
        for begin, end in seen:
            length = end - begin + 2.0 * recorded.period
            first, last = begin - recorded.period, end + recorded.period
            tried = [(first + a * length, last - b * length) for a in _NARROWER for b in _NARROWER]
            found += [_descended(left, window, length / 100) for window in sorted(tried, key=left)[:3]]
        return min(found, key=left)

    def law(self, values: Values) -> str:
        return "plate" if _of_plate(values) else "free"

    def free(self, values: Values) -> bool:
        return not _of_plate(values)

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        if _of_plate(values):
            return applied(plate_wrenches(recorded, values), np.array([values[name] for name in PUSHES]))
        forces = [values[f"force_{axis}_{k}"] for k in range(_MOST) for axis in "xyz"]
        return np.asarray(self.columns(recorded, values)[:, :, : len(forces)] @ forces)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        if _of_plate(nonlinear):
            pushes = plate_wrenches(recorded, nonlinear)
            return np.concatenate([np.zeros((len(recorded), 6, 3 * _MOST)), pushes], axis=2)
        point = np.array([nonlinear[name] for name in _POINT])
        whole = _hats(recorded.seconds, nonlinear["start"], nonlinear["length"], round(nonlinear["knots"]))
        rows = np.flatnonzero(whole.any(axis=1))
        out = np.zeros((len(recorded), 6, 3 * _MOST + len(PUSHES)))
        linear_bspline_basis, last = whole[rows], 3 * whole.shape[1]
        turn = recorded.rotation_world_sensor[rows]
        for axis in range(3):
            unit = forces_at(point, turn[:, axis])
            out[rows, :, axis:last:3] = unit[:, :, None] * linear_bspline_basis[:, None, :]
        return out

    def inert(self, values: Values) -> tuple[str, ...]:
        if _of_plate(values):
            return _OF_WINDOW
        return (*PLATE, *(f"force_{axis}_{k}" for k in range(round(values["knots"]), _MOST) for axis in "xyz"))

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        if _of_plate(values):
            return touches(recorded, values)
        return ((values["start"], values["start"] + values["length"]),)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """A contact pushes: a force that swings to both sides is an error of the motion, or a vibration.

        The wrench shows the line of the force, not the point on it: a point at the end of its range is plausible.
        """
        if _of_plate(values):
            return super().implausible(recorded, values) or no_plate(recorded, values)
        peak = _peak(values)
        size = float(np.linalg.norm(peak))
        pull = -float((_forces(values) @ peak).min()) / max(size, 1e-9)
        both = f"what pushes with {size:.1f} N would pull with {pull:.1f} N" if pull > _PULL * size else ""
        brief = f"it would last {1e3 * values['length']:.0f} ms" if values["length"] < _SHORTEST else ""
        return super().implausible(recorded, values) or brief or both

    def imitated(self, recorded: RecordedMotion, values: Values) -> str:
        """What rests takes energy from the tool and returns a part of it; a magnet gives first and takes it back.

        A person's hand or something that moves also gives, and keeps none: it pushes, so that it is a contact.
        """
        if _of_plate(values):
            return ""
        force = _hats(recorded.seconds, values["start"], values["length"], round(values["knots"])) @ _forces(values)
        point = np.array([values[name] for name in _POINT])
        velocity = recorded.velocity_in_world + recorded.to_world(cross(recorded.angular_velocity, point))
        work = np.sum(force * velocity, axis=1) * np.gradient(recorded.seconds)
        total, kept = float(np.abs(work).sum()), float(abs(work.sum()))
        given = float(np.cumsum(work).max(initial=0.0))
        return "joint_position" if given > _GIVEN * total and kept < _KEPT * total else ""

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        plate = _of_plate(values)
        peak = peak_on_plate(recorded, values) if plate else _peak(values)
        parts = {f"force_{axis}": (float(value), "N") for axis, value in zip("xyz", peak, strict=True)}
        found = {"peak_force": (float(np.linalg.norm(peak)), "N"), **parts}
        if not plate:
            return found
        normal = {f"normal_{axis}": (-float(n), "") for axis, n in zip("xyz", inward(values), strict=True)}
        deepest = (float(depth_inside(recorded, values).max()), "m")
        return {**found, **normal, "depth": deepest, "friction": (friction(values), "")}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        if _of_plate(values):
            peak = directed(peak_on_plate(recorded, values).tolist(), "N")
            when = [f"from {start:.1f} s to {end:.1f} s" for start, end in touches(recorded, values)]
            times = f"{len(when)} times, first " if len(when) > 1 else ""
            return (
                f"The tool pressed on a surface {times}{''.join(when[:1])}: up to {peak} of the world; "
                "the nominal model has no contact."
            )
        ((start, end),) = self.windows(recorded, values)
        return (
            f"From {start:.1f} s to {end:.1f} s something pushed on the tool: up to "
            f"{directed(_peak(values).tolist(), 'N')} of the world; the nominal model has no contact."
        )


def _of_plate(values: Values) -> bool:
    """Whether the law is that of a plate."""
    return values.get("law", _FREE) == _PLATE


def _peak(values: Values) -> Array:
    """(3,) the force at the knot where it is greatest, world axes."""
    forces = _forces(values)
    return np.asarray(forces[int(np.argmax(np.linalg.norm(forces, axis=1)))])


def _forces(values: Values) -> Array:
    """(K, 3) N at the knots in use, world axes."""
    return np.array([[values[f"force_{axis}_{k}"] for axis in "xyz"] for k in range(round(values["knots"]))])


def _straight(recorded: RecordedMotion, residual: Array, begin: float, end: float) -> Array:
    """(N, 6) the residual without the error that the contact caused in the calibration, as seen outside its window.

    A calibration that was fitted with the contact in the data is biased by it over the whole recording.
    """
    outside = (recorded.seconds < begin) | (recorded.seconds > end)
    if outside.sum() < _ENOUGH:
        return residual
    states = (
        np.ones((len(recorded), 1)),
        recorded.seconds[:, None],
        recorded.gravity,
        recorded.specific,
        recorded.prediction,
    )
    basis = np.hstack(states)
    basis /= np.maximum(np.abs(basis).max(axis=0), 1e-9)
    return np.asarray(residual - basis @ np.linalg.lstsq(basis[outside], residual[outside], rcond=1e-9)[0])


def _hats(seconds: Array, start: float, length: float, knots: int) -> Array:
    """(N, K) linear B-splines whose knots divide a window evenly."""
    place = (seconds - start) / length * (knots + 1)
    return np.maximum(1.0 - np.abs(place[:, None] - np.arange(1, knots + 1)), 0.0)


def _descended(
    left: Callable[[tuple[float, float]], float], window: tuple[float, float], step: float
) -> tuple[float, float]:
    """A pattern search: start and end move by a step while the fit improves, then by half of it."""
    least, smallest = left(window), step / 10
    while step > smallest:
        tried = [(window[0] + i * step, window[1] + j * step) for i, j in _MOVES]
        sizes = [left(each) for each in tried]
        if min(sizes) < least:
            window, least = tried[int(np.argmin(sizes))], min(sizes)
        else:
            step /= 2
    return window

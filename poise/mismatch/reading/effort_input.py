"""Input checks of joint efforts: zero, constant, without sign, of the opposite sign, of another unit, unrelated."""

from dataclasses import dataclass, replace

import numpy as np

from poise.mismatch.reading.effort_errors import driver_error, offset_and_friction, usable_efforts, without_delay
from poise.mismatch.reading.findings import InputFinding
from poise.mismatch.recorded import EffortTrack, RecordedMotion
from poise.types import Array, Mask

_KNOWN = 0.1
"""One sigma of a gain, relative, up to which the joint counts."""
_STRONG = 0.1
"""Least variation of a joint's modelled effort, relative to that of the strongest joint of its kind, that counts."""
_OTHER_UNIT = 4.0
"""Factor beyond which an effort is of another unit: wrong masses and payloads stay below."""
_COHERENT = 0.4
"""Scatter of the logarithm of the factor over the joints of one unit."""
_SAME = 0.1
"""Range of the logarithm of a factor that all joints share; rotors add to each joint what is its own."""
_NEGATIVE = (-2.0, -0.5)
"""Gains of efforts with the opposite sign."""
_UNRELATED = 0.3
"""Gain below which an effort does not contain what the model says."""
_BOTH_SIGNS = 0.1
"""Least share of samples of each sign for an effort that changes its sign."""
_MILLI = 1000.0


@dataclass(frozen=True)
class _Gain:
    """The factor between a joint's effort and the model's, beside friction, rotor and offset, with one sigma."""

    value: float
    std: float
    strength: float

    @property
    def known(self) -> bool:
        return self.std < _KNOWN * max(abs(self.value), 1.0) and self.strength > 0.0


_UNKNOWN = _Gain(0.0, np.inf, 0.0)


def checked_efforts(recorded: RecordedMotion, track: EffortTrack) -> tuple[EffortTrack | None, list[InputFinding]]:
    """The efforts that can be compared, and what was found about the others; None when none is left.

    Args:
        recorded: the motion, with the load.
        track: its efforts as measured, with what a rigid arm needs.
    """
    found: list[InputFinding] = []
    still = np.ptp(track.measured, axis=0) == 0.0
    for kind, mask in (
        ("zero", still & ~track.measured.any(axis=0)),
        ("constant", still & track.measured.any(axis=0)),
    ):
        if mask.any():
            names = track.named(mask)
            sentence = f"The effort of {', '.join(names)} is {kind} throughout: it is not measured, and was left out."
            found.append(InputFinding(f"effort_{kind}", sentence, names))
    if still.all():
        return None, found
    track = track.of_joints(~still)
    if _unsigned(track):
        sentence = (
            "The efforts have no sign: they are never negative, while the arm needs efforts of both signs. They were "
            "left out: friction, payload and gravity cannot be distinguished in a magnitude; record signed efforts."
        )
        return None, [*found, InputFinding("effort_unsigned", sentence, track.names)]
    error = driver_error(recorded, track)
    if error is not None:
        return None, [*found, error]
    track, left_out = usable_efforts(track)
    if not track.names:
        return None, [*found, *left_out]
    track, late = without_delay(track)
    gains = [_gain(track, j) for j in range(len(track.names))]
    return _by_gain(track, gains, [*found, *left_out, *late])


def _by_gain(
    track: EffortTrack, gains: list[_Gain], found: list[InputFinding]
) -> tuple[EffortTrack | None, list[InputFinding]]:
    """Efforts in N m with the contract's sign; without those of another unit."""
    known = np.array([gain.known for gain in gains])
    value = np.array([gain.value for gain in gains])
    if not known.any():
        return _without_rotors(track, found)
    size = np.abs(value[known])
    if (size > _OTHER_UNIT).all() or ((size < 1.0 / _OTHER_UNIT).all() and (size > 3.0 * _stds(gains, known)).all()):
        return _other_unit(track, value, known, found)
    if known.sum() > 1 and (value[known] < _UNRELATED).all() and not (value[known] < _NEGATIVE[1]).all():
        names = track.named(known)
        sentence = (
            f"The efforts of {', '.join(names)} do not contain the weight and inertia of the arm in robot_description "
            f"(factors {_listed(value[known])}): its gravity was subtracted, or the description is another robot's. "
            "The efforts were left out."
        )
        return None, [*found, InputFinding("effort_unrelated", sentence, names, tuple(value[known].tolist()))]
    turned = known & (value > _NEGATIVE[0]) & (value < _NEGATIVE[1])
    if turned.any():
        if known.sum() > 1 and (turned == known).all():
            turned[:] = True
        names = track.named(turned)
        mounted = ", or the robot is mounted upside down" if (turned == known).all() else ""
        sentence = (
            f"The effort of {', '.join(names)} has the opposite sign: it is what the load exerts on the joint"
            f"{mounted}. It was negated; the contract is what the joint exerts."
        )
        found = [*found, InputFinding("effort_sign", sentence, names, tuple(value[turned].tolist()))]
        track = replace(track, measured=np.where(turned, -track.measured, track.measured))
    return track, found


def _without_rotors(track: EffortTrack, found: list[InputFinding]) -> tuple[EffortTrack | None, list[InputFinding]]:
    """Efforts whose gains cannot be distinguished from rotors: one large factor for all joints is a unit."""
    gains = [_fitted_gain(track, joint, rotor=False) for joint in range(len(track.names))]
    known = np.array([gain.known for gain in gains])
    value = np.array([gain.value for gain in gains])
    size = np.abs(value[known])
    if known.sum() < 2 or size.min() < _OTHER_UNIT or np.ptp(np.log(size)) > _SAME:
        return track, found
    return _other_unit(track, value, known, found)


def _stds(gains: list[_Gain], known: Mask) -> Array:
    return np.array([gain.std for gain in gains])[known]


def _other_unit(
    track: EffortTrack, value: Array, known: Mask, found: list[InputFinding]
) -> tuple[EffortTrack | None, list[InputFinding]]:
    names, size = track.named(known), np.abs(value[known])
    factor = float(np.exp(np.median(np.log(size))))
    coherent = bool(np.std(np.log(size)) < _COHERENT)
    numbers = tuple(value[known].tolist())
    if coherent and abs(np.log(factor / _MILLI)) < np.log(1.5):
        sentence = f"The efforts are {factor:.0f} times the model's: they are in N mm, and were divided by 1000."
        finding = InputFinding("effort_unit", sentence, names, numbers)
        turned = replace(track, measured=track.measured / _MILLI)
        return turned, [*found, finding]
    if coherent:
        sentence = (
            f"The efforts are {factor:.3g} times what the model says: they are of another unit than N m (or N), "
            "or the masses of the description are wrong."
        )
    else:
        sentence = (
            f"The efforts are not in N m (or N): each joint has a factor of its own to what the model says "
            f"({', '.join(f'{name} {number:.3g}' for name, number in zip(names, numbers, strict=True))}), as motor "
            "currents or percent of the rated torque have."
        )
    sentence += " They were left out; give the gains in columns.yaml, or convert the recording."
    return None, [*found, InputFinding("effort_unit", sentence, names, numbers)]


def _unsigned(track: EffortTrack) -> bool:
    """No effort is ever negative, though the rigid arm needs both signs at some joint."""
    if float(track.measured.min()) < 0.0:
        return False
    both = [
        j
        for j in range(len(track.names))
        if _BOTH_SIGNS < np.mean(track.rigid[:, j] < 0.0) < 1.0 - _BOTH_SIGNS and np.ptp(track.rigid[:, j]) > 1e-9
    ]
    likelier = [_likeness(np.abs(track.rigid[:, j]), track, j) > _likeness(track.rigid[:, j], track, j) for j in both]
    return bool(both) and (len(track.names) > 2 or all(likelier))


def _likeness(values: Array, track: EffortTrack, joint: int) -> float:
    return float(np.corrcoef(values, track.measured[:, joint])[0, 1])


def _gain(track: EffortTrack, joint: int) -> _Gain:
    """The gain of a joint, with a rotor that adds to the inertia where it can be distinguished.

    A rotor only adds: where it cannot be distinguished, a gain that is too small or negative counts, and no other.
    """
    found = _fitted_gain(track, joint, rotor=True)
    if found.strength > 0.0:
        return found
    found = _fitted_gain(track, joint, rotor=False)
    return found if found.value < 1.0 / _OTHER_UNIT else _UNKNOWN


def _fitted_gain(track: EffortTrack, joint: int, *, rotor: bool) -> _Gain:
    """Least squares of an effort on the model's, beside friction, offset, and the inertia of a rotor."""
    rigid = track.rigid[:, joint]
    beside = offset_and_friction(track.velocity[:, joint])
    columns = np.stack([*beside, track.acceleration[:, joint]] if rotor else beside, axis=1)
    columns = columns / np.maximum(np.abs(columns).max(axis=0), 1e-12)
    own, rest = (
        values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        for values in (rigid, track.measured[:, joint])
    )
    strongest = float(np.std(track.rigid, axis=0).max())
    if np.std(rigid) < _STRONG * strongest or np.std(own) < 1e-3 * max(float(np.std(rigid)), 1e-9):
        return _UNKNOWN
    power = float(own @ own)
    value = float(own @ rest) / power
    left = rest - value * own
    # A residual that changes slowly holds fewer independent samples.
    alike = float(np.clip(left[1:] @ left[:-1] / max(float(left @ left), 1e-300), 0.0, 0.999))
    std = float(np.sqrt(left @ left / len(left) * (1.0 + alike) / (1.0 - alike) / power))
    return _Gain(value, std, float(np.std(own)))


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.2g}" for value in values)

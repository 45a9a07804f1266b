"""Why a scene on a base moved, or did not, against the prediction of the assembly engine."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from poise.assembly import Analysis, Assembly
from poise.errors import InputError, PoiseError
from poise.geometry import Pose, vector_of_rotation
from poise.mismatch.carried.causes import DECLARED_WITHIN, Candidate, SceneCause, families, moved_to, tilt
from poise.mismatch.carried.events import CarriedMotion, motions
from poise.mismatch.carried.evidence import Part, by_chance, elsewhere, of_course, parts_of, probability, undisturbed
from poise.mismatch.carried.prediction import Loading, SceneLimits, loading, mode_at
from poise.mismatch.carried.recorded import CarriedRecording
from poise.types import Array, Progress

_DECLARED, _PUSH = 0.5, 0.05
"""Prior probabilities that the scene is as declared, and of a push."""
_NAMED, _RIVAL = 0.5, 0.05
"""Probability from which on a cause is named, and from which on another one is its rival."""
_TEMPER = 0.8
"""Power of the probabilities of causes: less certain than the families say. Chosen, not fitted."""
_LEAST = 0.1
"""Probability of the likeliest cause, below which the answer is unknown."""
_ELSEWHERE, _TURNED = 0.01, np.deg2rad(3.0)
"""m and rad that an object may be off its place."""

_TELLS = {
    "tray_tilt": "under a tilt, the same acceleration in the opposite direction moves it later",
    "liquid": "a liquid does not swing under an acceleration that grows slowly, over 2 s or more",
    "push": "after a push, the same motion again moves nothing",
}
"""The motion that distinguishes a cause from its rivals."""


@dataclass(frozen=True)
class CarriedEffect:
    """A cause.

    Args:
        name: friction, com_height, tray_tilt, liquid, push, or object_pose.
        objects: that it is about.
        belief: its probability.
        parameter, value, deviation, unit: what it changes, to which value; NaN without one.
        bound: "" for an estimate; "at least" or "at most" where the recording shows no more.
        indistinguishable: other causes that explain as much.
        sentence: in words.
    """

    name: str
    objects: tuple[str, ...]
    belief: float
    parameter: str = ""
    value: float = float("nan")
    deviation: float = float("nan")
    unit: str = ""
    bound: str = ""
    indistinguishable: tuple[str, ...] = ()
    sentence: str = ""


@dataclass(frozen=True, eq=False)
class CarriedAnswer:
    """What a recording of a carried scene shows.

    Args:
        verdict: none, named, mixed or unknown.
        effects: the causes, the likeliest first.
        seen: what moved.
        predicted: what the scene as declared predicts; None: nothing moves.
        declared: probability that the scene is as declared.
        loading, seconds: of the scene as declared, (T,), (T,) s.
        notes: what to read it with.
    """

    verdict: str
    effects: tuple[CarriedEffect, ...]
    seen: tuple[CarriedMotion, ...]
    predicted: CarriedMotion | None
    declared: float
    loading: Loading
    seconds: Array
    notes: tuple[str, ...] = ()

    @property
    def most(self) -> float:
        """The largest load of the scene as declared: the acceleration over its limit."""
        return float(self.loading.most[-1])


def examine_carried(
    recording: CarriedRecording,
    scene: Assembly,
    deadline: float = math.inf,
    progress: Progress = lambda share: None,
) -> CarriedAnswer:
    """Hold a recording against the scene, and name what the scene has wrong.

    Args:
        recording: as read.
        scene: as declared.
        deadline: s after which no further causes are tried; a note names them.
        progress: of the search.

    Raises:
        InputError: as `Analysis.of`, for the scene as declared.
    """
    end = time.monotonic() + deadline
    Analysis.of(scene)  # a scene that is invalid by itself is refused
    displaced, there, notes = _placed(recording, scene)
    notes = [*recording.notes, *notes]
    seen = motions(recording, there)
    nominal = loading(there, recording.acceleration)
    predicted = _predicted(there, nominal, recording)
    declared, ranked, untried = _beliefs(recording, there, seen, end, progress)
    if untried:
        notes.append(f"the deadline left no time for {', '.join(untried)}")
    found = _effects(ranked)
    if recording.missing:
        notes.append(f"tf has no pose of {', '.join(recording.missing)}: whether they moved is not known")
    verdict = _verdict(declared, () if untried else found, bool(displaced))
    effects = (*displaced, *(found if verdict in ("named", "mixed") and declared < _NAMED else ()))
    return CarriedAnswer(verdict, effects, seen, predicted, declared, nominal, recording.seconds, tuple(notes))


def _verdict(declared: float, found: Sequence[CarriedEffect], displaced: bool) -> str:
    if declared >= _NAMED:
        return "named" if displaced else "none"
    if found and found[0].belief >= _NAMED:
        return "named"
    return "mixed" if found and found[0].belief >= _LEAST else "unknown"


def _placed(recording: CarriedRecording, scene: Assembly) -> tuple[list[CarriedEffect], Assembly, list[str]]:
    """Objects that are elsewhere, and the scene with them there, if they stand there."""
    effects, poses, notes = list[CarriedEffect](), dict[str, Pose](), list[str]()
    for name, track in recording.objects.items():
        item = scene.objects[scene.place_of(name)]
        pose = track.start
        shift = pose.translation - item.pose.translation
        angle = float(np.linalg.norm(vector_of_rotation(item.pose.rotation.T @ pose.rotation)))
        off = float(np.linalg.norm(shift))
        if off > max(_ELSEWHERE, 4 * track.noise[0]) or angle > max(_TURNED, 4 * track.noise[1]):
            words = f"{name} stands {1e3 * off:.0f} mm and {np.rad2deg(angle):.0f} deg from where the scene has it"
            effects.append(
                CarriedEffect("object_pose", (name,), 0.99, "shift", off, track.noise[0], "m", sentence=words)
            )
            level = item.pose.translation + shift * [1, 1, 0]
            poses[name] = Pose(pose.rotation if angle > _TURNED else item.pose.rotation, level)
    if not poses:
        return effects, scene, notes
    moved = moved_to(scene, poses)
    try:
        Analysis.of(moved)
    except InputError as error:
        notes.append(f"objects do not fit together where tf has them ({error.message}): the scene's poses are used")
        return effects, scene, notes
    return effects, moved, notes


def _predicted(scene: Assembly, nominal: Loading, recording: CarriedRecording) -> CarriedMotion | None:
    at = nominal.crossing()
    if at is None:
        return None
    mode, movers = mode_at(scene, recording.acceleration[at])
    name = next(iter(movers), next(item.id for item in scene.objects if not item.fixed))
    return CarriedMotion(name, mode, float(recording.seconds[at]), 0.0, float("nan"), float("nan"))


@dataclass(frozen=True, eq=False)
class _Tried:
    """A cause with its probability, its values (V,), their weights (V,), and the first motion that it concerns."""

    cause: SceneCause
    belief: float
    values: Array
    weights: Array
    first: CarriedMotion | None


@dataclass(frozen=True, eq=False)
class _Evidence:
    """The parts of a scene with their limits as declared, and the probability of what each did."""

    parts: Sequence[Part]
    limits: Sequence[SceneLimits]
    declared: Sequence[float]
    recording: CarriedRecording

    @classmethod
    def of(cls, recording: CarriedRecording, parts: Sequence[Part]) -> "_Evidence":
        limits = [SceneLimits.of(part.scene) for part in parts]
        found = cls(parts, limits, (), recording)
        felt = Candidate(0.0, 1.0, None, recording.acceleration, DECLARED_WITHIN)
        return replace(found, declared=[found.chance(felt, number) for number in range(len(parts))])

    def chance(self, candidate: Candidate, number: int) -> float:
        """Of what a part did, for a cause that concerns it."""
        try:
            limits = self.limits[number] if candidate.scene is None else SceneLimits.of(candidate.scene)
            seconds, noise = self.recording.seconds, self.recording.noise
            part = self.parts[number]
            course = 1.0 if candidate.swings else of_course(part, pushed=False)
            return course * probability(limits, candidate.acceleration, candidate.tolerance, part, seconds, noise)
        except PoiseError:  # such a scene cannot be: objects overlap, or fall
            return 0.0

    def others(self, number: int) -> float:
        """Of what all other parts did, for a cause that does not concern them."""
        seconds = self.recording.seconds
        found = [elsewhere(self.declared[n], part, seconds) for n, part in enumerate(self.parts) if n != number]
        return math.prod(found)

    def pushed(self, number: int) -> float:
        """Of what all parts did, if one was pushed."""
        part, seconds, noise = self.parts[number], self.recording.seconds, self.recording.noise
        felt = self.recording.acceleration
        still = undisturbed(self.limits[number], felt, DECLARED_WITHIN, part, seconds, noise)
        return still * of_course(part, pushed=True) * by_chance(part, seconds) * self.others(number)

    def tried(self, cause: SceneCause, number: int | None) -> _Tried:
        """A cause that concerns one part, or all of them."""
        tried = list(cause.candidates())
        every = range(len(self.parts))
        chances = [
            one.weight
            * (
                math.prod(self.chance(one, n) for n in every)
                if number is None
                else self.chance(one, number) * self.others(number)
            )
            for one in tried
        ]
        values, weights = np.array([one.value for one in tried]), np.array(chances)
        concerned = self.parts if number is None else (self.parts[number],)
        moved = [part.first for part in concerned if part.first is not None]
        first = min(moved, key=lambda motion: motion.time, default=None)
        return _Tried(cause, cause.prior * float(weights.sum()), values, weights, first)


def _beliefs(
    recording: CarriedRecording,
    scene: Assembly,
    seen: Sequence[CarriedMotion],
    end: float,
    progress: Progress,
) -> tuple[float, list[_Tried], list[str]]:
    """The probability of the scene as declared, those of the causes, the likeliest first, and what was not tried."""
    felt, none = recording.acceleration, np.zeros(0)
    evidence = _Evidence.of(recording, parts_of(recording, scene, seen))
    subjects = _subjects(evidence)
    declared = _DECLARED * math.prod(evidence.declared)
    rows, untried = list[_Tried](), list[str]()
    every = list[tuple[SceneCause, int | None]]()
    for number, name in subjects.items():
        first = evidence.parts[number].first
        if first is not None:
            pushed = SceneCause("push", (name,), "", "", _PUSH, lambda: iter(()))
            rows.append(_Tried(pushed, _PUSH / len(subjects) * evidence.pushed(number), none, none, first))
        causes = families(evidence.parts[number].scene, felt, name)
        every += [(replace(one, prior=one.prior / len(subjects)), number) for one in causes]
    every += [(tilt(scene, felt), None)] if subjects else []
    for done, (cause, place) in enumerate(every):
        if time.monotonic() > end:
            untried.append(_called(cause))
            continue
        rows.append(evidence.tried(cause, place))
        progress((done + 1) / len(every))
    left = sum(cause.prior for cause, _ in every if _called(cause) in untried)  # as if they explained all
    total = (declared + left + sum(row.belief for row in rows)) or 1.0
    ranked = sorted(_calibrated([replace(row, belief=row.belief / total) for row in rows]), key=lambda row: -row.belief)
    return declared / total, ranked, untried


def _calibrated(rows: Sequence[_Tried]) -> list[_Tried]:
    """The same probability of all causes together, less certain which one: families are rougher than what happens."""
    together = sum(row.belief for row in rows)
    spread = sum(row.belief**_TEMPER for row in rows) or 1.0
    return [replace(row, belief=together * row.belief**_TEMPER / spread) for row in rows]


def _subjects(evidence: _Evidence) -> dict[int, str]:
    """What moved first of each part, or is predicted to."""
    found = {}
    for number, (part, limits) in enumerate(zip(evidence.parts, evidence.limits, strict=True)):
        if part.first is not None:
            found[number] = part.first.object
            continue
        acceleration = evidence.recording.acceleration
        at = limits.loading(acceleration).crossing()
        if at is not None and evidence.recording.seconds[at] < part.until:
            found[number] = next(iter(mode_at(part.scene, acceleration[at])[1]), part.names[0])
    return found


def _effects(ranked: Sequence[_Tried]) -> tuple[CarriedEffect, ...]:
    """The likeliest cause, with its value and its rivals."""
    if not ranked or not ranked[0].belief:
        return ()
    best, cause, first = ranked[0], ranked[0].cause, ranked[0].first
    rivals = tuple(_called(row.cause) for row in ranked[1:] if row.belief > _RIVAL)
    if not len(best.values):
        return (_worded(CarriedEffect(cause.name, cause.objects, best.belief, indistinguishable=rivals), first),)
    value, deviation, bound = _value(best, first is None)
    found = CarriedEffect(
        cause.name, cause.objects, best.belief, cause.parameter, value, deviation, cause.unit, bound, rivals
    )
    return (_worded(found, first),)


def _called(cause: SceneCause) -> str:
    return f"{cause.name} of {' and '.join(cause.objects)}" if cause.objects else cause.name


def _value(row: _Tried, still: bool) -> tuple[float, float, str]:
    """Mean and standard deviation of the parameter; or, where nothing moved, its bound."""
    weights = row.weights / row.weights.sum()
    mean = float(weights @ row.values)
    deviation = float(np.sqrt(weights @ (row.values - mean) ** 2))
    if not still:
        return mean, deviation, ""
    order = np.argsort(row.values)
    upward = float(weights @ (row.values - row.values.mean())) > 0
    place = int(np.searchsorted(np.cumsum(weights[order]), 0.05 if upward else 0.95))
    return float(row.values[order][min(place, len(order) - 1)]), deviation, "at least" if upward else "at most"


def _worded(effect: CarriedEffect, first: CarriedMotion | None) -> CarriedEffect:
    """With its sentence."""
    who = " and ".join(effect.objects)
    about = f"{effect.bound} " if effect.bound else ""
    spread = "" if effect.bound else f" +- {effect.deviation:.2g}"
    words = {
        "friction": f"the friction of {who} is {about}{effect.value:.2f}{spread}",
        "com_height": f"the centre of mass of {who} is {about}{1e3 * effect.value:.0f} mm higher than declared",
        "tray_tilt": f"the base leans by {about}{abs(np.rad2deg(effect.value)):.1f} deg more than its frame says",
        "liquid": f"a part of {who} swings at about {effect.value:.1f} Hz, as a liquid does",
        "push": f"{who} was pushed: the base accelerated as much before without moving it, or not at all",
    }[effect.name]
    if effect.name == "com_height" and first is not None and first.mode == "tip":
        words += (
            "; a rounded edge would look the same. A rounded edge shortens all levers by one length, a higher centre of"
            " mass divides all limits by one factor: accelerate across a longer side of the base, too"
        )
    names = {effect.name, *(rival.split(" of ")[0] for rival in effect.indistinguishable)}
    for each, motion in _TELLS.items():
        if effect.indistinguishable and each in names:
            words += f"; {motion}"
    return replace(effect, sentence=words)

"""A diagnosis for reports: residuals in units of the noise, the ladder of evidence, sentences."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from poise.mismatch.answer import Diagnosis, SignalDiagnosis
from poise.mismatch.inference import names, residual_of, state_description
from poise.types import Array, Mask
from poise.viewing.page import Finding
from poise.viewing.summary import WHITENESS_LAGS, Whiteness, whiteness
from poise.viewing.wording import readable

_STRETCH = 0.25
"""s over which a residual's size is averaged for display."""
_ALONE, _BESIDE = 8, 3
"""Hypotheses that are drawn: single effects, and those with as many effects as the answer or one more."""
_SPELT = 2
"""Names of an answer up to which every hypothesis is written out."""
_SURE = 0.9
"""Probability below which a name is reported with a warning."""
_MUCH = 1.25
"""Held-out error, in units of the noise, from which a model is reported as incomplete."""


@dataclass(frozen=True, eq=False)
class ScaledResiduals:
    """One signal's residuals, in its units.

    Args:
        seconds: (N,).
        names: (C) of the channels.
        units: (C).
        before, after: (N, C) measured minus predicted by the nominal and by the best model. The calibration
            errors of the best model are removed from both: a fit without the findings would bias them.
        noise: (N, C) one sigma.
        held: (N,) samples that no fit of the proof used.
    """

    seconds: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    before: Array
    after: Array
    noise: Array
    held: Mask

    def size(self, residual: Array) -> Array:
        """(N,) root mean square over channels and a quarter of a second, in units of the noise."""
        energy = np.mean((residual / self.noise) ** 2, axis=1)
        count = max(round(_STRETCH / float(np.median(np.diff(self.seconds)))), 1)
        kernel = np.ones(count) / count
        padded = np.pad(energy, (count // 2, count - 1 - count // 2), mode="reflect")
        return np.asarray(np.sqrt(np.convolve(padded, kernel, mode="valid")))


def residuals(examination: SignalDiagnosis) -> ScaledResiduals:
    """The residuals of a signal under both models."""
    problem = examination.problem
    effort = problem.recorded.effort if problem.signal == "effort" else None
    units = ("N",) * 3 + ("N m",) * 3 if effort is None else tuple(effort.unit("N m", name) for name in effort.names)
    before = problem.measured - problem.predicted(problem.recorded) - examination.best.calibrated
    after = residual_of(problem, examination.best)
    return ScaledResiduals(
        problem.seconds, problem.channels, units, before, after, problem.noise.total, examination.held_out
    )


@dataclass(frozen=True)
class Rung:
    """One hypothesis of the ladder: what it adds, the log evidence it wins over the nominal model, whether it won."""

    label: str
    gain: float
    answer: bool


def ladder(examination: SignalDiagnosis) -> list[Rung]:
    """The answer, the single effects that came furthest, its rivals and what would come next; the best first."""
    state = examination.search
    answer = tuple(sorted(names(examination.best)))
    base = state.fits[()].log_evidence if () in state.fits else examination.nominal.log_evidence
    gains = {tuple(sorted(key)): each.log_evidence - base for key, each in state.fits.items()}
    for (known, effect), gain in state.gains.items():
        key = tuple(sorted((*known, effect)))
        if key not in gains and tuple(sorted(known)) in gains:
            gains[key] = gains[tuple(sorted(known))] + gain
    gains.setdefault(answer, examination.best.log_evidence - base)
    gains[()] = 0.0

    def best(count: int, keys: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
        return sorted((key for key in keys if key != answer), key=lambda key: -gains[key])[:count]

    kept = {answer, ()}
    kept.update(best(_ALONE, (key for key in gains if len(key) == 1)))
    kept.update(best(_BESIDE, (key for key in gains if len(key) == len(answer) > 1)))
    kept.update(best(_BESIDE, (key for key in gains if len(key) == len(answer) + 1 and set(answer) < set(key))))
    possible = (key for key in sorted(kept, key=lambda key: -gains[key]) if np.isfinite(gains[key]))
    return [Rung(_beside(key, answer), gains[key], key == answer) for key in possible]


def _beside(key: tuple[str, ...], answer: tuple[str, ...]) -> str:
    """A hypothesis for display; by its difference from an answer of many names."""
    if len(answer) <= _SPELT or len(key) <= 1:
        return labelled(key)
    less, more = (tuple(sorted(set(one) - set(other))) for one, other in ((answer, key), (key, answer)))
    changes = [f"without {labelled(less)}"] * bool(less) + [f"with {labelled(more)}"] * bool(more)
    return f"the answer {', '.join(changes)}".rstrip()


def labelled(parts: tuple[str, ...]) -> str:
    """The names of a hypothesis' effects for display."""
    return " + ".join(_label(part) for part in parts) or "nothing: the nominal model"


def _label(name: str) -> str:
    kind, _, state = name.partition(":")
    return f"some function of {state_description(state)}" if kind == "unknown" else name.replace("_", " ")


def remaining(examination: SignalDiagnosis) -> tuple[Array, list[Whiteness]]:
    """Whitened residual (N, C) of the best model, and how white each channel is."""
    channels = examination.problem.measured.shape[1]
    white = examination.best.regression.residual.reshape(channels, -1)
    return white.T, [whiteness(channel) for channel in white]


def correlations(series: Array) -> Array:
    """(20, C) autocorrelations of (N, C) at one to twenty samples."""
    centred = series - series.mean(axis=0)
    power = np.maximum(np.sum(centred**2, axis=0), 1e-12)
    return np.array([np.sum(centred[:-lag] * centred[lag:], axis=0) / power for lag in range(1, WHITENESS_LAGS + 1)])


def headline(found: Diagnosis) -> tuple[str, str]:
    """The verdict in a word or two, and the sentence under it."""
    named = " + ".join(finding.effect.name.replace("_", " ") for finding in found.findings)
    if found.verdict == "none":
        return "No mismatch", "The recording and the simulation agree within the declared tolerances."
    if found.unknown is None:
        return _capital(named), " ".join(finding.sentence for finding in found.findings)
    unknown = found.unknown.sentence
    if found.verdict == "unknown":
        return "Unknown physics", unknown
    return f"{_capital(named)} + something unknown", " ".join(
        [*(finding.sentence for finding in found.findings), unknown]
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def remarks(found: Diagnosis, notes: tuple[str, ...]) -> list[Finding]:
    """What a person should know before using the answer."""
    proof, sentences = found.main.proof, []
    if found.verdict == "none":
        sentences.append(Finding("good", "No effect is named: the recording agrees within the tolerances."))
    else:
        sentences.append(
            Finding(
                "good" if proof.augmented < _MUCH else "warn",
                f"Held-out error, times the noise: {proof.as_given:.2f} as given, {proof.nominal:.2f} with the nominal "
                f"model calibrated on the rest, {proof.augmented:.2f} with what was found.",
            )
        )
    for finding in found.findings:
        chance, name = finding.belief.probability, finding.effect.name.replace("_", " ")
        sentences.append(Finding("good" if chance > _SURE else "warn", f"{name}: probability {100 * chance:.1f} %."))
        if finding.belief.alike:
            others = ", ".join(_label(other) for other in finding.belief.alike)
            sentences.append(
                Finding(
                    "warn",
                    f"This motion does not distinguish {name} from {others}; "
                    f"this one would: {finding.effect.separating_motion}.",
                )
            )
    if found.unknown is not None:
        sentences.append(Finding("warn", "Something remains that no effect of the library explains."))
    if found.rest_sentence:
        sentences.append(Finding("note", readable(found.rest_sentence, 500)))
    sentences += [Finding("note", note) for note in notes]
    return sentences

"""What an effect is: physics that the nominal model leaves out, as a plug-in of one file.

A new effect is one new file in this folder with one subclass of `Effect` (it is found by looking through the folder,
see `poise.mismatch.effects`) and its test. The same `simulate` serves the diagnosis and the simulator, so that a found
effect corrects the simulation at once.

Vocabulary: the *prediction* is the reading (N, 6) that the model expects, with the effects of earlier layers in it;
a *response* is what an effect adds to it. Layers act in the order kinematics, load, event, sensor: a
sensor effect sees the prediction with all forces in it.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from poise.geometry import applied
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

Layer = Literal["kinematics", "load", "event", "sensor", "friction"]
Values = Mapping[str, float]

LAYERS: tuple[Layer, ...] = ("kinematics", "load", "event", "sensor", "friction")
"""In the order in which they act; friction acts on joint efforts alone."""

_EDGE = 1e-6
"""Of the unit interval: a fit stops a parameter this far from an end of its range."""
_LONGEST = 0.2
"""Longest step of a fit in the prior of a parameter, as a share of its width."""
_END = 1e-4
"""Of the unit interval: a parameter this close to an end of its range was stopped there."""


@dataclass(frozen=True)
class EffectParameter:
    """One number that an effect has.

    Args:
        name: in lower case; with an axis or joint behind an underscore where there are several (`force_x`).
        unit: SI, as text; "" for a ratio.
        scale: of a linear parameter: one sigma of its prior, a normal distribution about zero: its typical size. The
            search also tries 1/3 and 3 times it.
        low, high: of a non-linear parameter: its prior is uniform between them; values outside are not tried. Of a
            linear parameter: its physical bounds; a fit may cross them, but its effect is then implausible.
        linear: the response is proportional to it, for given non-linear parameters.
        log: the prior of a non-linear parameter is uniform in its logarithm (times, frequencies, stiffnesses).
        peaked: the prior of a non-linear parameter is a Cauchy distribution about zero with half-width `scale`, cut at
            low and high: mostly small, sometimes large.
        choice: a non-linear parameter that takes few whole values (the number of a joint); it is taken from
            `Effect.starts` and never refined.
        resolution: of a non-linear parameter that the response does not follow smoothly (the moment of a step): how
            finely `Effect.starts` resolves it. No step of a fit changes it; a search moves those in s.
        positive: of a linear parameter: a physical bound, no fit goes below zero (a mass, a drag, a friction).
        known: of a positive parameter: what the nominal model has of it already, which a fit may take away.
        vanishes: at its low end, a non-linear parameter stands for none (no damping, no slack), so that a fit may end
            there.
        hidden: kept in the model, not reported (`Effect.derived` reports physical quantities instead).
        law_error: one sigma that no recording removes, since the true law differs from the effect's: relative for
            positive parameters and for those that are uniform in their logarithm, else in `unit`.
    """

    name: str
    unit: str
    scale: float = 1.0
    low: float = -np.inf
    high: float = np.inf
    linear: bool = True
    log: bool = False
    peaked: bool = False
    choice: bool = False
    resolution: float = 0.0
    positive: bool = False
    known: float = 0.0
    vanishes: bool = False
    hidden: bool = False
    law_error: float = 0.0

    def law_sigma(self, value: float) -> float:
        """`law_error` in `unit`."""
        return self.law_error * (abs(value) if self.log or self.positive else 1.0)

    @property
    def lower(self) -> float:
        """The least value that a fit may give to a linear parameter."""
        return -self.known if self.positive else -np.inf

    def at_bound(self, value: float) -> bool:
        """Whether a linear parameter is held at zero by its physical bound.

        One that takes away all that the nominal model has is at a bound as well; it has a response.
        """
        return self.positive and not self.known and value <= 1e-9 * self.scale

    def within(self, value: float) -> bool:
        """Whether a linear parameter is inside its physical bounds; non-linear ones never leave their range."""
        return not self.linear or max(self.low, self.lower) - 1e-9 * self.scale <= value <= self.high

    def at_end(self, value: float) -> bool:
        """Whether a fit pressed a non-linear parameter against an end of its range."""
        at = self.to_unit(value)
        return not self.linear and (at >= 1.0 - _END or (at <= _END and not self.vanishes))

    def to_unit(self, value: float) -> float:
        """Where a value lies in its prior, 0 to 1 (the distribution function); 0.5 where there is one value only."""
        if self.low == self.high:  # the number of the joint of a robot with one joint
            return 0.5
        low, high, at = (self._stretched(number) for number in (self.low, self.high, value))
        return float(np.clip((at - low) / (high - low), 0.0, 1.0))

    def from_unit(self, place: float) -> float:
        """The value at a place 0 to 1 of its prior."""
        low, high = self._stretched(self.low), self._stretched(self.high)
        value = low + (high - low) * min(max(place, 0.0), 1.0)
        return float(np.exp(value)) if self.log else float(np.tan(value) * self.scale) if self.peaked else value

    def moved(self, value: float, step: float) -> float:
        """The value after a step in its prior, limited to its range.

        Of a peaked prior the step follows the tangent: a response is nearly linear in the value, not in its place.
        Other responses are linear nearby only: far away, one parameter of many may end in a valley of its own.
        """
        least, most = self.from_unit(_EDGE), self.from_unit(1.0 - _EDGE)
        if not self.peaked:
            near = min(max(step, -_LONGEST), _LONGEST)
            return self.from_unit(min(max(self.to_unit(value) + near, _EDGE), 1.0 - _EDGE))
        width = self._stretched(self.high) - self._stretched(self.low)
        rate = width * self.scale * (1.0 + (value / self.scale) ** 2)
        return min(max(value + step * rate, least), most)

    def _stretched(self, value: float) -> float:
        return float(np.log(value)) if self.log else float(np.arctan(value / self.scale)) if self.peaked else value


def values_at(parameters: Sequence[EffectParameter], places: Array) -> dict[str, float]:
    """The values of parameters at places (P,) 0 to 1 of their priors."""
    return {p.name: p.from_unit(float(place)) for p, place in zip(parameters, places, strict=True)}


class Effect(ABC):
    """Physics that the nominal model leaves out.

    Attributes:
        name: as in the answer, snake_case.
        layer: its place in the chain from joints to reading.
        signal: "wrench", or "effort" for what acts on joint efforts: responses are then (M, J) at the samples of
            `recorded.effort`, instead of (N, 6).
        equation, source: the physics in one line of text, and its reference.
        excited_by: what a motion must contain to show it.
        separating_motion: the motion that distinguishes it from `confused_with`; a sentence.
        confused_with: names of effects that produce nearly equal residuals on poor motions.
        fast: it shows above 4 Hz or in single samples (vibration, impacts, clipping): it is always tried at the full
            rate, other effects first at a fifth of it.
        order: among effects of one layer, the lower acts first.
        needs: what the recording must hold: any of "joints", "effort", "base" (a base that moves), "load".
        transfers: its parameters hold in another recording; False for events.
        knocks: its response is a row of knocks, whose moments are known roughly.
        lacks: share of the response of the real thing that its law leaves out, whose trace in the residual is not
            against it.
        varies: by its nature its size changes with time or place, which is then not against it.
        free_course: of an event: splines fit its time course, so that one half of it does not predict the other.
        rough: its starting points may explain little of what a fit from them explains: it is fitted in any case.
        made_of: names of effects that it contains beside further terms; where these terms vanish, they are the answer.
            An answer never names an effect beside one that contains it.
        general: it can imitate several other effects; where it does no better, one of them is the answer.
        most: how many of its kind a model may have.
        direct: the readings alone show it (`detected`), for any model: it does not compete with others.
        defaults: parameters that models saved by an earlier version lack, with the values that they then had.
        preferred: a rival that does as well is less likely, as the search takes the simplest; False for a cause that is
            rarer than its rivals, and simpler.
        commoner: names of likelier causes of the same data: it is a finding only where these and the tolerances do not
            explain the data.
        delay: name of the parameter, s, by which slow wrenches are late; "" for an effect that does not delay them.
        late: derived quantity, s, by which wrenches are late at the end: less than the tolerance of the clock is no
            finding; "" for an effect that does not make them late by and by.
        turn: derived quantity, rad, by which the load turns on the sensor: less than the tolerance of the sensor's
            rotation is no finding; "" for an effect that does not turn it.
        of_joint: parameters that are values of one joint: the stem of their names, and what `JointPhysics` calls it.
        lasting: all its parameters are linear, and its columns are the same array for each prediction of a motion.
        dry: friction that carries a load of up to its size while the joint is at rest.
        widens: name of the calibration group (poise.mismatch.inference.calibration) whose tolerance it exceeds, or "";
            see `exceeds`.
    """

    name: ClassVar[str]
    layer: ClassVar[Layer]
    signal: ClassVar[Literal["wrench", "effort"]] = "wrench"
    equation: ClassVar[str]
    source: ClassVar[str]
    excited_by: ClassVar[str]
    separating_motion: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()
    transfers: ClassVar[bool] = True
    order: ClassVar[int] = 0
    fast: ClassVar[bool] = False
    knocks: ClassVar[bool] = False
    varies: ClassVar[bool] = False
    lacks: ClassVar[float] = 0.0
    free_course: ClassVar[bool] = False
    rough: ClassVar[bool] = False
    made_of: ClassVar[tuple[str, ...]] = ()
    general: ClassVar[bool] = False
    most: ClassVar[int] = 1
    direct: ClassVar[bool] = False
    preferred: ClassVar[bool] = True
    commoner: ClassVar[tuple[str, ...]] = ()
    delay: ClassVar[str] = ""
    late: ClassVar[str] = ""
    turn: ClassVar[str] = ""
    widens: ClassVar[str] = ""
    of_joint: ClassVar[Mapping[str, str]] = {}
    lasting: ClassVar[bool] = False
    dry: ClassVar[bool] = False
    defaults: ClassVar[Values] = {}

    @abstractmethod
    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        """Its parameters; they may depend on the recording (one per joint, times within it)."""

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Starting points of the search for the non-linear parameters: few, found in the data.

        Args:
            recorded: the recording.
            residual: (N, 6) or (M, J), measured minus predicted, calibration errors taken out.

        Yields:
            Values of all non-linear parameters. An effect without non-linear parameters keeps this default.
        """
        del recorded, residual
        yield {}

    def detected(self, recorded: RecordedMotion) -> Values | None:
        """Of a `direct` effect: its values, where the readings show it and it matters relative to the noise."""
        del recorded
        return None

    def differs(self, values: Values, stated: Values) -> bool:
        """Of a `direct` effect: whether the values that the readings show contradict those that the model states."""
        del values, stated
        return False

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        """(N, 6, k) or (M, J, k): the response to one unit of each linear parameter, in the order of `parameters`.

        (N, 6, 0) for an effect without linear parameters, which overrides `simulate`.
        """
        del nonlinear
        rows, channels = self._measured(recorded).shape
        return np.zeros((rows, channels, 0))

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        """(N, 6) or (M, J): the exact response to all parameters, to be added to `recorded.prediction`.

        For given non-linear parameters it is `columns` times the linear ones.
        """
        linear = np.array([values[p.name] for p in self.parameters(recorded) if p.linear])
        return applied(self.columns(recorded, values), linear)

    def renewed(self, values: Values) -> Values:
        """The values of a model that an earlier version saved, in the parameters of this version."""
        return values

    def twins(self, recorded: RecordedMotion, values: Values) -> tuple[str, ...]:
        """Names of effects that contain this one or act alike, and that are as likely at these values."""
        del recorded, values
        return ()

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        """When it acts, as (start, end) in seconds of the recording's clock; empty: all the time."""
        del recorded, values
        return ()

    def unsettled(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        """Short windows (start, end), s, in which its response is known in size only, as in a knock.

        A knock that is a fraction of a sample late differs as much as one that is not there: further effects are not
        searched in these windows, and predictions are not compared there.
        """
        del recorded, values
        return ()

    def law(self, values: Values) -> str:
        """The one of its laws that these values follow, where it has several; the best starts of each are compared."""
        del values
        return ""

    def free(self, values: Values) -> bool:
        """Whether its course is free at these values, see `free_course`."""
        del values
        return self.free_course

    def exceeds(self, values: Values) -> frozenset[str]:
        """Names of the calibration groups whose tolerances it exceeds at these values, see `widens`."""
        del values
        return frozenset({self.widens} - {""})

    def general_at(self, start: Values) -> bool:
        """Whether it can imitate several other effects from this starting point, see `general`."""
        del start
        return self.general

    def inert(self, values: Values) -> tuple[str, ...]:
        """Names of parameters on which the response does not depend at these values: those of another law."""
        del values
        return ()

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        """Further quantities to report, {name: (value, unit)}: functions of the parameters."""
        del recorded, values
        return {}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """Why these values are physically impossible, as a clause; "" when they are possible.

        No answer contains an effect with implausible values: here a linear parameter beyond its bounds, or a peaked one
        at an end of its range. An effect with bounds on derived quantities (a path, a total mass) overrides this
        and asks its base class, too.
        """
        inert = self.inert(values)
        for p in self.parameters(recorded):
            if p.name in inert or not (p.linear or p.peaked):
                continue
            if not p.within(values[p.name]) or (p.peaked and p.at_end(values[p.name])):
                return f"{p.name} would be {values[p.name]:.3g} {p.unit}".rstrip()
        return ""

    def imitated(self, recorded: RecordedMotion, values: Values) -> str:
        """The state that another cause depends on which acts like these values; "" where nothing speaks for one.

        That cause is as likely as an event of free course, and as any effect beside an unknown part of the answer.
        """
        del recorded, values
        return ""

    def untestable(self, recorded: RecordedMotion) -> str:
        """Why this recording cannot show the effect, as the end of a sentence; "" when it can."""
        lacking = [what for what in self.needs if not recorded.has(what)]
        return f"the recording has no {' and no '.join(lacking)}" if lacking else ""

    @abstractmethod
    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        """What happened, in one sentence with the numbers that matter; it ends with what the model lacks."""

    def _measured(self, recorded: RecordedMotion) -> Array:
        return recorded.wrench if self.signal == "wrench" or recorded.effort is None else recorded.effort.measured

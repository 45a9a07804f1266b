"""Every hypothesis solved on its own, and their answers averaged by how well they predict the samples."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poise.inertia.bayes.curvature import ANY_MASS, curved_covariance
from poise.inertia.bayes.first_guess import EXPECTED
from poise.inertia.bayes.hypotheses import Hypotheses
from poise.inertia.bayes.mass_model import MassModel, compiled_search
from poise.inertia.bayes.posterior import Posterior, SolverEffort
from poise.inertia.bayes.sensor_bias import WithoutBias
from poise.inertia.bayes.small_systems import apply, normalised, seen_through, solve
from poise.inertia.model import N_UNKNOWNS, NormalEquations, mixed
from poise.kernels import COMPILED, CompiledSearch
from poise.types import Array, Indices

_LARGEST_FALL = 0.8
"""Share of its mass that a part may lose in one step."""

_LARGEST_STEP = 0.5
"""Of a deformation."""

_SHORTENING = 0.25
"""Of a step that made things worse."""

_IDENTITY = np.eye(N_UNKNOWNS)
_TINY = 1e-20
"""Variance of a density that has none, as that of a single part: far below all others, far above rounding."""


class ModelAverage:
    """Bayesian model averaging over the hypotheses about one `MassModel`.

    For one hypothesis the prior of the state is a Gaussian and phi a smooth function of it, so that the posterior is
    found by Gauss-Newton, and the evidence by Laplace's method. With the model linearised, phi ~ N(mu, R R^T), and the
    bias integrated out, phi = mu + R (1 + R^T H R)^-1 R^T (g - H mu): no prior is ever inverted, so a variance of zero
    is as good as any.

    Args:
        model: which phi there are.
        hypotheses: how probable.
        starts: (B, n) states to start from, for each case of the bias; the log mass of the expected one sets the scale.
    """

    def __init__(self, model: MassModel, hypotheses: Hypotheses, starts: Array) -> None:
        self.model = model
        self.hypotheses = hypotheses
        self._guess = np.zeros(model.n_states)
        self._guess[: model.n_parts] = starts[EXPECTED, : model.n_parts]
        self._scale = float(np.exp(self._guess[0]))
        self._starts = starts
        self._states = starts[hypotheses.bias_case]
        # The variances of a hypothesis are along the columns of root, those of densities along axes of the likeness.
        self._root = np.eye(model.n_states)
        if model.likeness is not None:
            self._root[: model.n_parts, : model.n_parts] = model.likeness_axes[1]
        self._unrooted = self._root[: model.n_parts, : model.n_parts]  # its transposed inverse is itself
        self.kernel: CompiledSearch | None = None
        if COMPILED:
            self.kernel = compiled_search(model, self._guess, self._root, self._unrooted, self._scale, ANY_MASS)
        self.consider()

    @cached_property
    def first_phi(self) -> Array:
        """(10,) of the body that the search starts from, in the sensor frame."""
        return np.asarray(self.model.to_sensor @ self.model.evaluate(self._guess[None])[0][0])

    def consider(self, *cases: int) -> None:
        """Look at these hypotheses only, or at all of them again when none is named."""
        self._left = np.array(cases or range(len(self.hypotheses)), dtype=np.int64)

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """What the compiled search is given of the hypotheses."""
        names = ("state_variances", "bias_variances", "log_probability", "bias_case", "twins", "scouts")
        given = {name: getattr(self.hypotheses, name) for name in names}
        return given | {"to_sensor": self.model.to_sensor, "starts": self._starts, "first_phi": self.first_phi}

    @property
    def states(self) -> Array:
        """(H, n) where the search begins, or has got to."""
        return self._states

    def refine(
        self, normals: NormalEquations, likelihood: Callable[[Array, Indices], Array], effort: SolverEffort
    ) -> Posterior:
        """Solve every hypothesis that is left, from where it was left, and average.

        Args:
            normals: the samples, weighted as the last answer suggests; (B, 16, 16) and (B, 16), for each bias case.
            likelihood: log likelihood (H,) of unknowns (H, 16) of bias cases (H,), each weighted as it says itself.
            effort: how hard to try.
        """
        case = self.hypotheses.bias_case[self._left]
        reduced = WithoutBias.of(self._scaled(normals), self.hypotheses.bias_variances)
        variances = self.hypotheses.state_variances[self._left]
        states, phi, penalty, determinants = self._climbed(self._states[self._left], variances, reduced, case, effort)
        self._states[self._left] = states
        unknowns = np.concatenate([phi, reduced.bias(case, phi)], axis=1)
        back = self._to_sensor()
        log = likelihood(unknowns @ back.T, case) - penalty - determinants / 2
        log += self.hypotheses.log_probability[self._left] + reduced.log_prior(case, unknowns[:, 10:])
        log = self.hypotheses.balanced(self._left, log)
        keep = normalised(log) >= effort.negligible
        self._left, case = self._left[keep], case[keep]
        self._answer = _Answers(states[keep], unknowns[keep], log[keep], reduced, self._left, case, back)
        return self._posterior(self._answer, self._narrowed(states[keep], reduced.information, case))

    def with_curvature(self) -> Posterior:
        """The last answer, with a covariance that holds where the model is not linear."""
        found = self._answer
        variances = self.hypotheses.state_variances[found.left]
        to_states = self._root * np.sqrt(variances)[:, None]
        inner = curved_covariance(
            self._linearised, self.model.n_parts, found.states, to_states, found.reduced.information[found.case]
        )
        return self._posterior(found, inner)

    def with_even_parts(self, posterior: Posterior, normal: NormalEquations) -> Posterior:
        """The mean of cases in which uneven parts are improbable, with its mean square error under all cases.

        The samples of a short motion hardly distinguish uneven parts from noise, and a mean that contains them follows
        the noise. They stay in the covariance, about the new mean.

        Args:
            posterior: the answer.
            normal: the samples, at the delay of the answer.
        """
        chances = normalised(self.hypotheses.for_answer(posterior.left, posterior.log_weights)) - posterior.weights
        if not chances.any():
            return posterior
        phi = self.model.evaluate(posterior.states)[0] / self._scale
        bias = self._reduced(normal).bias(posterior.bias_cases, phi)
        return posterior.moved(self._to_sensor() @ (chances @ np.concatenate([phi, bias], axis=1)))

    def with_materials(self, posterior: Posterior, normal: NormalEquations) -> Posterior:
        """The answer with densities of materials where the shape is as stated, with its mean square error as before.

        Args:
            posterior: the answer with densities of any size.
            normal: the samples, at the delay of the answer.
        """
        cases, mass = self.hypotheses, float(posterior.phi[0])
        likely = cases.materials.likely(self.model.shares, mass) if cases.materials and mass > 0 else None
        if likely is None:
            return posterior
        weights, n_parts = posterior.weights, self.model.n_parts
        case = np.argmax(np.bincount(posterior.bias_cases, weights))
        reduced = self._reduced(normal)
        samples = reduced.information[case], reduced.vector[case]
        found, log = [], []
        for variances, chance in cases.of_answer:
            phi, evidence = likely.bodies(self._linearised, samples, variances[n_parts:])
            found.append(phi)
            log.append(evidence + np.log(chance))
        phi, chances = np.concatenate(found), normalised(np.concatenate(log))
        unknowns = np.concatenate([phi, reduced.bias(np.full(len(phi), case), phi)], axis=1)
        share = weights @ cases.as_stated[posterior.left]
        return posterior.moved(share * (self._to_sensor() @ (chances @ unknowns) - posterior.unknowns))

    def _reduced(self, normal: NormalEquations) -> WithoutBias:
        """The same samples for each case of the bias."""
        scaled, variances = self._scaled(normal), self.hypotheses.bias_variances
        one = np.zeros(len(variances), dtype=np.int64)
        return WithoutBias.of(NormalEquations(scaled.information[None][one], scaled.vector[None][one]), variances)

    def _posterior(self, found: "_Answers", inner: Array) -> Posterior:
        """The average of hypotheses, from their covariances (H, 10, 10)."""
        weights = normalised(found.log_weights)
        covariance = found.reduced.joint_covariance(found.case, inner)
        mean = weights @ found.unknowns
        scatter = found.unknowns - mean
        total = mixed(weights, covariance + scatter[:, :, None] * scatter[:, None, :])
        total = found.back @ (total + total.T) @ found.back.T / 2
        return Posterior(found.back @ mean, total, found.states, found.left, found.case, found.log_weights)

    def shown(self, normal: NormalEquations, posterior: Posterior) -> Array:
        """(10, 10) information about phi that is in the samples alone, the bias as uncertain as before them."""
        variance = posterior.weights @ self.hypotheses.bias_variances[posterior.bias_cases]
        scaled = self._scaled(normal)
        stack = NormalEquations(scaled.information[None], scaled.vector[None])
        inverse = np.linalg.inv(self._to_sensor()[:10, :10])
        return np.asarray(inverse.T @ WithoutBias.of(stack, variance[None]).information[0] @ inverse)

    def along(self, normals: NormalEquations, posterior: Posterior | None) -> tuple[Array, Array]:
        """Log evidence (B, L) and unknowns (B, L, 16), for each case of the bias, at lags that differ a little.

        The model is linearised about what each case has arrived at; or, without a posterior, about the first guess.

        Args:
            normals: (L, 16, 16) and (L, 16).
            posterior: the answer for one of the lags.
        """
        scaled = self._scaled(normals)
        states, variances = self._typical(posterior)
        phi, jacobian = self._linearised(states)
        full = np.zeros((len(states), N_UNKNOWNS, N_UNKNOWNS))
        full[:, range(10, 16), range(10, 16)] = self.hypotheses.bias_variances
        root = jacobian @ self._spread(variances)
        full[:, :10, :10] = root @ root.swapaxes(1, 2)
        mean = np.zeros((len(states), N_UNKNOWNS))
        mean[:, :10] = phi + apply(jacobian, self._guess - states)
        gradient = scaled.vector - (scaled.information @ mean[:, None, :, None])[..., 0]  # (B, L, 16)
        system = _IDENTITY + full[:, None] @ scaled.information
        step = solve(system, (gradient @ full)[..., None])[..., 0]
        log = np.sum(gradient * step, axis=-1) + ((scaled.vector + gradient) @ mean[:, :, None])[..., 0]
        return (log - np.linalg.slogdet(system)[1]) / 2, (mean[:, None] + step) @ self._to_sensor().T

    def _typical(self, posterior: Posterior | None) -> tuple[Array, Array]:
        """(B, n) states and (B, n) prior variances, on average over the hypotheses with the same case of the bias.

        A case that was dropped takes those of the others, so that it comes back with a delay that fits the answer.
        """
        scouts = self.hypotheses.scouts
        states, variances = self._starts.copy(), self.hypotheses.state_variances[scouts]
        if posterior is None:
            return states, variances
        for case in range(len(scouts)):
            same = posterior.bias_cases == case
            same |= not same.any()
            weights = normalised(posterior.log_weights[same])
            states[case] = weights @ posterior.states[same]
            variances[case] = weights @ self.hypotheses.state_variances[posterior.left[same]]
        return states, variances

    def _climbed(
        self, states: Array, variances: Array, reduced: WithoutBias, case: Indices, effort: SolverEffort
    ) -> tuple[Array, Array, Array, Array]:
        """What `_climb` arrives at: (H, n) states, (H, 10) phi, (H,) penalty, (H,) log |1 + C H|."""
        mode = self._climb(states, variances, reduced, case, effort)
        root = self._linearised(mode.states)[1] @ self._spread(variances)
        system, scale = seen_through(root, reduced.information[case])
        determinants = np.linalg.slogdet(system)[1] + 2 * np.log(scale).sum(axis=1)
        return mode.states, mode.phi, mode.penalty, determinants

    def _climb(
        self, states: Array, variances: Array, reduced: WithoutBias, case: Indices, effort: SolverEffort
    ) -> "_Mode":
        """Gauss-Newton on H hypotheses at once, each until it has settled; a step for the worse is shortened.

        Args:
            states: (H, n) to start from.
            variances: (H, n) of the prior.
            reduced: normal equations, and
            case: (H,) which of them.
            effort: how hard to try.
        """
        mode = _Mode.at(states)
        step, length = np.zeros_like(mode.states), np.ones(len(mode.states))
        moving = np.arange(len(mode.states))
        for _ in range(effort.max_iterations):
            trial = self._moved(mode.states[moving], step[moving], length[moving])
            phi, jacobian = self._linearised(trial)
            penalty = self._penalty(trial, variances[moving])
            linear, square = reduced.vector[case[moving]], reduced.information[case[moving]]
            log = np.sum(phi * (linear - apply(square, phi) / 2), axis=1) - penalty
            gain = log - mode.log[moving]
            better = gain >= 0
            length[moving] = np.where(better, 1.0, length[moving] * _SHORTENING)
            gained = moving[better]
            for target, value in zip(
                (mode.states, mode.phi, mode.penalty, mode.log),
                (trial[better], phi[better], penalty[better], log[better]),
                strict=True,
            ):
                target[gained] = value
            step[gained] = self._gauss_newton(
                trial[better], phi[better], jacobian[better], variances[gained], square[better], linear[better]
            )
            moving = moving[np.abs(gain) > effort.tolerance]
            if not len(moving):
                break
        return mode

    def _gauss_newton(
        self, states: Array, phi: Array, jacobian: Array, variances: Array, square: Array, linear: Array
    ) -> Array:
        """(H, n) relative changes of part masses and changes of deformations.

        phi is linear in the masses: only their sign limits the step. Parts that would lose more than is allowed lose
        that, and the others make the best of it. In units of the prior, what the samples do not show is not lost in the
        rounding of what they show sharply.
        """
        n_parts = self.model.n_parts
        offset = self._guess - states
        free = np.ones(offset.shape, dtype=bool)
        for _ in range(2):
            spread = self._spread(variances) * free[:, :, None]
            root = jacobian @ spread
            gradient = linear - apply(square, phi + apply(jacobian, offset))
            system, scale = seen_through(root, square)
            pull = apply(root.swapaxes(1, 2), gradient) / scale
            step = offset + apply(spread, solve(system, pull[..., None])[..., 0] / scale)
            lost = step[:, :n_parts] < -_LARGEST_FALL
            if not lost.any():
                break
            offset[:, :n_parts][lost] = -_LARGEST_FALL
            free[:, :n_parts][lost] = False
        return np.asarray(step)

    def _moved(self, states: Array, step: Array, length: Array) -> Array:
        """States after a share of their steps, with all of them short enough for masses to stay positive."""
        n_parts = self.model.n_parts
        fall = -step[:, :n_parts].min(axis=1) / _LARGEST_FALL
        turn = np.abs(step[:, n_parts:]).max(axis=1) / _LARGEST_STEP
        taken = step * (length / np.maximum(1.0, np.maximum(fall, turn)))[:, None]
        taken[:, :n_parts] = np.log1p(taken[:, :n_parts])
        return np.asarray(states + taken)

    def _linearised(self, states: Array) -> tuple[Array, Array]:
        """(H, 10) phi and (H, 10, n) its derivative, in units of the guessed mass."""
        phi, jacobian = self.model.evaluate(states)
        return phi / self._scale, jacobian / self._scale

    def _spread(self, variances: Array) -> Array:
        """(H, n, n + 1) root of the prior covariance of states, the total mass, which may be anything, last."""
        common = np.zeros((*variances.shape, 1))
        common[:, : self.model.n_parts] = np.sqrt(ANY_MASS)
        return np.concatenate([self._root * np.sqrt(variances)[:, None], common], axis=2)

    def _narrowed(self, states: Array, informations: Array, case: Indices) -> Array:
        """(H, 10, 10) posterior covariance of phi; symmetric all the way, so that it stays positive."""
        variances = self.hypotheses.state_variances[self._left]
        information = informations[case]
        root = self._linearised(states)[1] @ self._spread(variances)
        back = root.swapaxes(1, 2)
        seen = back @ information @ root
        try:
            half = np.linalg.inv(np.linalg.cholesky(np.eye(root.shape[2]) + seen)) @ back
        except np.linalg.LinAlgError:  # rounding has made information negative that there is none of
            eigenvalues, vectors = np.linalg.eigh(seen)
            half = (vectors / np.sqrt(1 + eigenvalues.clip(min=0.0))[:, None]).swapaxes(1, 2) @ back
        return np.asarray(half.swapaxes(1, 2) @ half)

    def _penalty(self, states: Array, variances: Array) -> Array:
        """(H,) minus the log of the prior: densities about a common one, that about the guess, deformations."""
        n_parts = self.model.n_parts
        densities, deformations = (states - self._guess)[:, :n_parts] @ self._unrooted, states[:, n_parts:]
        ones = self._unrooted.sum(axis=0)  # what all densities have in common, when the rest has nothing in common
        weights = 1 / np.maximum(variances[:, :n_parts], _TINY)
        number = weights @ ones**2
        common = np.sum(weights * densities * ones, axis=1) / number
        apart = np.sum(weights * (densities - common[:, None] * ones) ** 2, axis=1)
        together = common**2 / (1 / number + ANY_MASS)
        return np.asarray((apart + together + np.sum(deformations**2 / variances[:, n_parts:], axis=1)) / 2)

    def _to_sensor(self) -> Array:
        """(16, 16) from normalised phi in units of the guessed mass, and bias, to the sensor frame."""
        back = np.eye(N_UNKNOWNS)
        back[:10, :10] = self.model.to_sensor * self._scale
        return back

    def _scaled(self, normal: NormalEquations) -> NormalEquations:
        """The same in normalised phi, in units of the guessed mass."""
        back = self._to_sensor()
        return NormalEquations(back.T @ normal.information @ back, normal.vector @ back)


@dataclass(frozen=True, eq=False)
class _Answers:
    """The hypotheses that are left: (H, n) states, (H, 16) unknowns, (H,) log weights, and what they followed from."""

    states: Array
    unknowns: Array
    log_weights: Array
    reduced: WithoutBias
    left: Indices
    case: Indices
    back: Array


@dataclass(eq=False)
class _Mode:
    """Where Gauss-Newton has got to, per hypothesis.

    Args:
        states: (H, n) best so far.
        phi: (H, 10) there.
        penalty: (H,) minus the log of the prior there.
        log: (H,) log of likelihood times prior there, up to what a hypothesis keeps to itself.
    """

    states: Array
    phi: Array
    penalty: Array
    log: Array

    @classmethod
    def at(cls, states: Array) -> "_Mode":
        """Nothing known yet of these states."""
        n = len(states)
        return cls(states.copy(), np.zeros((n, 10)), np.zeros(n), np.full(n, -np.inf))

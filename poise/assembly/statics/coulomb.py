"""Elastic contacts of a block: no tension, Coulomb friction limited by the normal forces that arise.

Limit analysis asks whether contact forces in balance exist. Between two walls they exist at any magnitude, although
nothing presses the walls to the cube. Here normal forces arise only where bodies are pushed into each other.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, eye_array
from scipy.sparse.linalg import splu

from poise.assembly.contact import Interface
from poise.assembly.statics.block import BlockGeometry, Sparse, assembled
from poise.assembly.statics.deadline import NO_DEADLINE, Deadline
from poise.assembly.statics.friction_surface import patch_friction
from poise.geometry import plane_axes
from poise.types import Array, Mask

# Stiffness of a weak spring to the ground that supports unsupported bodies, per mean contact stiffness.
_CATCH = 1e-8
# A block stands when the catch carries less than this share of the load.
_CARRIED = 2e-4
# What may be left of the equations, per load.
_SETTLED = 1e-7
# Newton steps in a row; Tresca rounds between two attempts of it; attempts.
_STEPS, _ROUNDS, _ATTEMPTS = 60, 3, 5
# A push grows in steps of 1 / PUSHOVER of the target, longer after success, shorter after failure; most steps.
_PUSHOVER, _GROW, _CUT, _PUSHES = 6, 1.5, 5, 60
FACTOR_TOLERANCE = 0.002
"""Relative tolerance of the load factor at which a block collapses."""
# Systems up to this size are solved dense; numbers up to which the map from contacts to bodies is kept dense.
_DENSE, _CELLS = 120, 200_000
# Share of an interface's stiffness at its corners; the rest is at the cells within.
_AT_CORNERS = 0.3


@dataclass(frozen=True, eq=False)
class ElasticState:
    """The equilibrium of a block on elastic contacts.

    Args:
        stands: the contacts alone carry the load.
        unbalanced: share of the load that they do not carry.
        displacement: (6 n,) in units of load per mean stiffness.
        known: it was found before the deadline.
    """

    stands: bool
    unbalanced: float
    displacement: Array
    known: bool = True


class CoulombBlock:
    """Elastic contacts of one block: no tension, Coulomb friction, rigid bodies.

    Slip is against friction, without the dilatancy that limit analysis assumes. Solved by a semismooth Newton method
    on the whole law (Alart, Curnier 1991); where that is stuck, rounds of Tresca problems give a new start (Nečas,
    Jarušek, Haslinger 1980): with friction bounded by the last round's normal forces, the equilibrium is the minimum
    of a convex energy.
    """

    def __init__(self, geometry: BlockGeometry, interfaces: list[Interface]) -> None:
        """Take a block and its interfaces in order."""
        self.geometry = geometry
        points, frames, stiffness, friction, number = _elastic_points(geometry, interfaces)
        wrenches = np.concatenate([frames, np.cross(points[:, None], frames)], axis=2)
        bodies = geometry.supports[number]
        grasp = assembled(wrenches, bodies, geometry.count)
        small = np.prod(grasp.shape) <= _CELLS
        self._grasp = grasp.toarray() if small else grasp
        self._motion = np.ascontiguousarray(self._grasp.T) if small else grasp.T.tocsr()
        self._stiffness, self._friction = stiffness, friction
        self._catch = _CATCH * float(stiffness.mean())
        count = grasp.shape[0]
        self._ground = self._catch * (np.eye(count) if small else eye_array(count, format="csc"))

    def settle(self, load: Array, start: Array | None = None, deadline: Deadline = NO_DEADLINE) -> ElasticState:
        """Find the equilibrium under a load (6 n,), gravity included, in the block's units.

        Args:
            load: N and N m, in those units.
            start: (6 n,) displacement to start from; None: of contacts that do not slip.
            deadline: when it passes, the state is not `known`.
        """
        size = float(np.linalg.norm(load)) or 1.0
        bounds = np.full(len(self._stiffness), np.inf)
        displacement = self._tresca(load, bounds, np.zeros_like(load)) if start is None else start
        for _ in range(_ATTEMPTS):
            found, left = self._newton(load, displacement, deadline)
            unbalanced = left + self._catch * float(np.linalg.norm(found)) / size
            if left <= _SETTLED:
                return ElasticState(unbalanced <= _CARRIED, unbalanced, found)
            for _ in range(_ROUNDS):
                if deadline.passed:
                    return ElasticState(False, unbalanced, found, known=False)
                pressed = self._friction * np.maximum(-self._stiffness * self._relative(displacement)[:, 0], 0.0)
                bounds = pressed if np.isinf(bounds).all() else (bounds + pressed) / 2
                displacement = self._tresca(load, bounds, np.zeros_like(load))
        return ElasticState(False, max(unbalanced, _CARRIED), found)

    @cached_property
    def rest(self) -> ElasticState:
        """The state under gravity alone."""
        return self.settle(self.geometry.gravity.ravel())

    def holds(self, load: Array, deadline: Deadline = NO_DEADLINE) -> bool:
        """Whether the block stands under gravity and a push (6 n,), as far as it is found from the state at rest."""
        return self.rest.stands and self._follow(self.geometry.gravity.ravel() + load, self.rest, deadline).stands

    def factor(self, load: Array, above: float, deadline: Deadline = NO_DEADLINE) -> tuple[float, bool]:
        """The factor up to which the block stands under gravity and this load (6 n,), at most `above`.

        Returns:
            The factor, and whether it is known; when the deadline passed, it is what was reached by then.
        """
        gravity = self.geometry.gravity.ravel()
        if deadline.passed:
            return 0.0, False
        state = self.rest
        if not state.stands:
            return 0.0, True
        pushed = self._follow(gravity + above * load, state, deadline)
        if pushed.stands:
            return above, True
        reached, step = 0.0, above / _PUSHOVER
        for _ in range(_PUSHES):
            pushed = self._follow(gravity + (reached + step) * load, state, deadline)
            if deadline.passed:
                return reached, False
            close = FACTOR_TOLERANCE * max(reached, FACTOR_TOLERANCE * above)
            if pushed.stands:
                reached, state = reached + step, pushed
                step = min(_GROW * step, (above - reached) / 2)
            elif step > close:
                step /= _CUT
            if above - reached <= close or (not pushed.stands and step <= close / _CUT):
                break
        return reached, True

    def _follow(self, load: Array, state: ElasticState, deadline: Deadline) -> ElasticState:
        """The state after a change of load, near the last one; one that is not found at once does not stand."""
        found, left = self._newton(load, state.displacement, deadline)
        if left > _SETTLED:  # stuck on the way: start from contacts that do not slip
            bonded = self._tresca(load, np.full(len(self._stiffness), np.inf), state.displacement)
            found, left = self._newton(load, bonded, deadline)
        unbalanced = left + self._catch * float(np.linalg.norm(found)) / (float(np.linalg.norm(load)) or 1.0)
        return ElasticState(unbalanced <= _CARRIED, unbalanced, found)

    def _relative(self, displacement: Array) -> Array:
        """(P, 3) displacement of the second body relative to the first at each point: parting, and two tangents."""
        return np.asarray(self._motion @ displacement).reshape(-1, 3)

    def _newton(self, load: Array, start: Array, deadline: Deadline) -> tuple[Array, float]:
        """Displacement (6 n,) at which contacts, slipping as Coulomb says, carry a load; and what is left, per load."""
        u, size = start, float(np.linalg.norm(load)) or 1.0
        rest = self._left(u, load)
        left = float(np.linalg.norm(rest))
        for _ in range(_STEPS):
            if left <= _SETTLED / 10 * size or deadline.passed:
                break
            step = -_solve(self._jacobian(u), rest)
            length = 1.0
            while length > 1e-3:
                new = self._left(u + length * step, load)
                if float(np.linalg.norm(new)) <= (1 - 1e-4 * length) * left:
                    break
                length /= 2
            else:
                break
            u, rest, left = u + length * step, new, float(np.linalg.norm(new))
        return u, left / size

    def _left(self, u: Array, load: Array) -> Array:
        """What contacts and catch leave of a load, negated."""
        forces = self._forces(u, None)
        return np.asarray(self._catch * u - load - self._grasp @ forces.ravel())

    def _jacobian(self, u: Array) -> Array | Sparse:
        """(6 n, 6 n) derivative of `_left`; not symmetric, because friction follows the normal force."""
        relative, k = self._relative(u), self._stiffness
        slide = np.linalg.norm(relative[:, 1:], axis=1)
        closed = relative[:, 0] <= 0
        bounds = self._friction * np.where(closed, -k * relative[:, 0], 0.0)
        blocks, direction, slips = self._tangent(relative, slide, bounds, closed)
        blocks[:, 1:, 0] = -(self._friction * k * (slips & closed))[:, None] * direction
        return self._assembled(blocks)

    def _tangent(self, relative: Array, slide: Array, bounds: Array, closed: Mask) -> tuple[Array, Array, Mask]:
        """Stiffness (P, 3, 3) with friction bounds held, directions of slip (P, 2), and which points slip (P,)."""
        k = self._stiffness
        slips = k * slide > bounds
        safe = np.where(slide > 0, slide, 1.0)
        direction = relative[:, 1:] / safe[:, None]
        across = np.where(slips, np.where(slips, bounds, 0.0) / safe, k)
        blocks = np.zeros((len(k), 3, 3))
        # Open contacts keep a trace of stiffness, so that a step never leaps without end.
        blocks[:, 0, 0] = np.where(closed, k, 1e-9 * k)
        blocks[:, 1:, 1:] = across[:, None, None] * np.eye(2)
        along = np.einsum("ij,ik->ijk", direction, direction)
        blocks[:, 1:, 1:] -= np.where(slips, across, 0.0)[:, None, None] * along
        return blocks, direction, slips

    def _assembled(self, blocks: Array) -> Array | Sparse:
        """(6 n, 6 n) stiffness of the bodies of that of the points (P, 3, 3), and of the catch."""
        if isinstance(self._grasp, np.ndarray):
            size = len(self._grasp)
            stiff = np.einsum("apk,pkl->apl", self._grasp.reshape(size, -1, 3), blocks).reshape(size, -1)
            return np.asarray(stiff @ self._motion + self._ground)
        at = np.arange(3 * len(blocks)).reshape(-1, 3)
        rows, columns = np.repeat(at, 3, axis=1).ravel(), np.tile(at, (1, 3)).ravel()
        points = csc_array((blocks.ravel(), (rows, columns)), shape=(at.size, at.size))
        stiffness = self._grasp @ points @ self._motion + self._ground
        return stiffness.toarray() if stiffness.shape[0] <= _DENSE else stiffness

    def _forces(self, displacement: Array, bounds: Array | None) -> Array:
        """(P, 3) contact forces; friction limited to the bounds (P,), by default to what Coulomb's law says."""
        forces = -self._stiffness[:, None] * self._relative(displacement)
        forces[:, 0] = np.maximum(forces[:, 0], 0.0)
        limits = self._friction * forces[:, 0] if bounds is None else bounds
        size = np.linalg.norm(forces[:, 1:], axis=1)
        forces[:, 1:] *= np.minimum(1.0, limits / np.where(size > 0, size, 1.0))[:, None]
        return forces

    def _tresca(self, load: Array, bounds: Array, start: Array) -> Array:
        """The displacement (6 n,) of least energy with friction limited to the bounds, by Newton with a line search."""
        u = start
        energy, gradient = self._energy(u, load, bounds)
        for _ in range(_STEPS):
            if float(np.linalg.norm(gradient)) <= 1e-9 * float(np.linalg.norm(load)):
                break
            relative = self._relative(u)
            slide = np.linalg.norm(relative[:, 1:], axis=1)
            blocks, _, _ = self._tangent(relative, slide, bounds, relative[:, 0] <= 0)
            step = -_solve(self._assembled(blocks), gradient)
            slope = float(gradient @ step)
            length = 1.0
            for _ in range(30):
                new_energy, new_gradient = self._energy(u + length * step, load, bounds)
                if new_energy <= energy + 1e-4 * length * slope:
                    break
                length /= 2
            else:
                break
            u, energy, gradient = u + length * step, new_energy, new_gradient
        return u

    def _energy(self, u: Array, load: Array, bounds: Array) -> tuple[float, Array]:
        """Energy of contacts, catch and load at a displacement, and its gradient."""
        relative, k = self._relative(u), self._stiffness
        pressed = np.minimum(relative[:, 0], 0.0)
        slide = np.linalg.norm(relative[:, 1:], axis=1)
        stick = k * slide <= bounds
        with np.errstate(invalid="ignore"):
            friction = np.where(stick, k * slide**2 / 2, bounds * slide - bounds**2 / (2 * k))
        energy = float(k @ pressed**2 / 2 + friction.sum() + self._catch * (u @ u) / 2 - load @ u)
        gradient = self._catch * u - load - self._grasp @ self._forces(u, bounds).ravel()
        return energy, gradient


def _solve(matrix: Array | Sparse, right: Array) -> Array:
    """Solve a linear system: few bodies dense, many sparse (each touches few others)."""
    if isinstance(matrix, np.ndarray):
        return np.asarray(np.linalg.solve(matrix, right))
    return np.asarray(splu(matrix.tocsc()).solve(right))


def _elastic_points(
    geometry: BlockGeometry, interfaces: list[Interface]
) -> tuple[Array, Array, Array, Array, NDArray[np.int64]]:
    """Points (P, 3), frames (P, 3, 3), stiffness (P,), friction (P,) and interface (P,) of the elastic contacts."""
    units = geometry.units
    areas = np.array([interface.area for interface in interfaces])
    mean = areas[areas > 0].mean() if np.any(areas > 0) else 1.0
    sizes = np.where(areas > 0, np.maximum(areas / mean, 1e-2), 1e-1)
    points, frames, stiffness, number = [], [], [], []
    for i, (interface, size) in enumerate(zip(interfaces, sizes, strict=True)):
        friction = patch_friction(interface)
        cells = friction.surface.cells()
        inner = friction.centroid + friction.size * cells.places @ friction.axes
        share = _AT_CORNERS if interface.area > 0 else 1.0
        corners = len(interface.points)
        weights = [np.full(corners, share / corners)]
        places = [interface.points]
        if interface.area > 0:
            places.append(inner)
            weights.append((1 - share) * cells.weights)
        count = corners + (len(inner) if interface.area > 0 else 0)
        points.append((np.concatenate(places) - units.origin) / units.length)
        frames.append(np.broadcast_to(np.vstack([interface.normal, plane_axes(interface.normal)]), (count, 3, 3)))
        stiffness.append(size * np.concatenate(weights))
        number.append(np.full(count, i))
    which = np.concatenate(number)
    mu = np.array([interface.friction for interface in interfaces])[which]
    return np.concatenate(points), np.concatenate(frames), np.concatenate(stiffness), mu, which

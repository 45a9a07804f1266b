"""Which accelerations a body on one interface sustains: a cone of effective gravities, in closed form."""

import numpy as np

from poise.assembly.contact import Interface
from poise.assembly.statics import BlockAnalysis, hull_edges, patch_friction
from poise.types import Array


class GravityCone:
    """Effective gravities under which a body stays on the one interface that holds it.

    Gravity and inertia act along one line through the centre of mass. The body stays while that line leaves the hull
    of the patch on its inside and its angle to the normal is within friction; no moment turns the patch, so that
    `limit` and `patch` agree.
    """

    def __init__(self, interface: Interface, faces_body: bool, com: Array) -> None:
        """Take an interface whose normal points into the body (or not), and the com (3,) of all that it carries."""
        friction = patch_friction(interface)
        normal = interface.normal if faces_body else -interface.normal
        inward, offset = hull_edges((interface.points - friction.centroid) @ friction.axes.T)
        inward = inward @ friction.axes
        arm = com - friction.centroid
        # The line meets the plane at arm + g height / (-g . n): inside each edge this is linear in g.
        sides = inward * (arm @ normal) - np.outer(inward @ arm - offset, normal)
        self._sides = np.vstack([sides, -normal])
        self._normal, self._mu, self._arm = normal, interface.friction, arm

    @classmethod
    def of(cls, block: BlockAnalysis) -> "GravityCone":
        """Of a block of one body on one interface, and what it carries."""
        objects, members = block.structure.assembly.objects, block.block.members[0]
        masses = np.array([objects[place].mass for place in members])
        com = masses @ np.array([objects[place].com_in_world for place in members]) / masses.sum()
        return cls(block.interfaces[0], block.block.supports[0][1] == 0, com)

    def spare(self, gravity: Array) -> float:
        """m by which the line of the weight passes inside the edges of the patch, 0 for lines and points; inf where the
        centre of mass is below the patch, so that what turns about an edge comes back."""
        pressing = -float(self._normal @ gravity)
        if pressing <= 0 or self._arm @ gravity >= 0:
            return np.inf
        return float((self._sides[:-1] @ gravity).min()) / pressing

    def factors(self, gravity: Array, changes: Array) -> tuple[Array, Array]:
        """How far changes (D, 3) of the effective gravity may be followed.

        Returns:
            (D,) the factor at which gravity + factor * change leaves the cone, and whether by slipping.
        """
        start = np.maximum(self._sides @ gravity, 0.0)
        fall = changes @ self._sides.T
        with np.errstate(divide="ignore", invalid="ignore"):
            topple = np.where(fall < 0, start / -fall, np.inf).min(axis=1)
        slip = self._slip(gravity, changes)
        return np.minimum(topple, slip), slip < topple

    def _slip(self, gravity: Array, changes: Array) -> Array:
        """(D,) first factor at which the tangential part exceeds friction; both sides of that are squared."""
        pressing, sliding = self._split(gravity)
        d_pressing, d_sliding = self._split(changes)
        a = self._mu**2 * d_pressing**2 - np.einsum("ij,ij->i", d_sliding, d_sliding)
        b = self._mu**2 * pressing * d_pressing - d_sliding @ sliding
        c = max(float(self._mu**2 * pressing**2 - sliding @ sliding), 0.0)
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        # The first positive root of a s^2 + 2 b s + c, in the form that does not cancel. Without friction, and at the
        # edge of it, c is 0: what moves away from the cone slips at once.
        with np.errstate(divide="ignore", invalid="ignore"):
            towards = np.where(b < 0, c / (root - b), np.inf)
            found = np.where((b >= 0) & (a < 0), (b + root) / -a, towards)
        return np.where(np.isnan(found), np.inf, found)

    def _split(self, vectors: Array) -> tuple[Array, Array]:
        """Parts (...) against the normal and (..., 3) in the plane."""
        pressing = -(vectors @ self._normal)
        return pressing, vectors + pressing[..., None] * self._normal

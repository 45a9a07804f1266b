"""What a stereo depth camera makes of an exact image: noise, steps, holes, shadows and flying pixels, like a D435."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from poise.fake_robots.rasteriser import Rendering
from poise.types import Array, Mask


@dataclass(frozen=True)
class StereoNoise:
    """Errors of active stereo (Intel RealSense D400 series datasheet and its tuning guide; Ahn et al. 2019 measured
    a D435's depth error growing with the square of the distance).

    Args:
        baseline: m between the two imagers.
        focal: pixels of the imagers (which are not the image's, that is aligned to the colour camera).
        subpixel: pixels, one sigma of the disparity.
        smear: pixels over which neighbouring errors are alike.
        step: m, unit of the depth image.
        nearest: m below which there is no depth.
        edge: m between neighbouring pixels from which on they count as an edge.
        holes, flying: shares of the pixels at edges that are lost, or lie somewhere between the two sides.
        grazing: cosine of the angle below which surfaces give no depth.
        lost: share of all other pixels that are lost.
    """

    baseline: float = 0.05
    focal: float = 385.0
    subpixel: float = 0.08
    smear: float = 0.8
    step: float = 1e-3
    nearest: float = 0.17
    edge: float = 0.01
    holes: float = 0.5
    flying: float = 0.3
    grazing: float = 0.12
    lost: float = 0.002

    def sigma(self, depth: float) -> float:
        """m, one sigma at a depth."""
        return depth**2 * self.subpixel / (self.focal * self.baseline)


D435 = StereoNoise()


def measured(
    seen: Rendering, focal: float, noise: StereoNoise, rng: np.random.Generator, blind: Array | None = None
) -> NDArray[np.uint16]:
    """(H, W) steps of depth (16UC1) that the camera reports; 0 where it has none.

    Args:
        seen: the exact image.
        focal: pixels, of the image.
        noise: what goes wrong.
        rng: draws it.
        blind: (H, W) pixels that give no depth, as glass or mirrors do; None: none.
    """
    depth = seen.depth.copy()
    known = depth > 0
    low, high = minimum_filter(np.where(known, depth, np.inf), 3), maximum_filter(depth, 3)
    at_edge = known & (high - low > noise.edge)
    draw = rng.random(depth.shape)
    flies = at_edge & (draw < noise.flying)
    depth[flies] = low[flies] + rng.random(int(flies.sum())) * (high - low)[flies]
    gone = at_edge & (draw > 1 - noise.holes)
    gone |= rng.random(depth.shape) < noise.lost
    gone |= ~known | (seen.facing < noise.grazing) | _shadow(seen.depth, focal * noise.baseline)
    if blind is not None:
        gone |= blind.astype(bool)
    white = gaussian_filter(rng.normal(size=depth.shape), noise.smear)
    white /= 1 / (2 * np.sqrt(np.pi) * noise.smear)  # a Gaussian filter leaves this of unit white noise
    depth += white * depth**2 * noise.subpixel / (noise.focal * noise.baseline)
    gone |= depth < noise.nearest
    return np.where(gone, 0, np.clip(np.round(depth / noise.step), 0, 65535)).astype(np.uint16)


def _shadow(depth: Array, scale: float) -> Mask:
    """What the second imager cannot see because something nearer is in front of it."""
    disparity = np.divide(scale, depth, out=np.zeros_like(depth), where=depth > 0)
    across = np.arange(depth.shape[1]) - disparity
    nearer = np.minimum.accumulate(across[:, ::-1], axis=1)[:, ::-1]
    behind = np.concatenate([nearer[:, 1:], np.full((len(depth), 1), np.inf)], axis=1)
    return np.asarray(across > behind + 0.5)

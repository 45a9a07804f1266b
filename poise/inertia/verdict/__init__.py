"""Whether a payload explains its samples."""

from poise.inertia.verdict.samples import FitSamples, SampleBins

__all__ = ["FitSamples", "SampleBins"]

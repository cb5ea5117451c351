"""Free decays: frequency and damping of one mode against its amplitude.

found = fit_free_decay(tip, sample_hz)
"""

from middeck.identification.free_decay.decay_fit import FreeDecay, fit_free_decay
from middeck.identification.free_decay.releases import find_releases

__all__ = ["FreeDecay", "find_releases", "fit_free_decay"]

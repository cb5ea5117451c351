"""Free decays: frequency and damping of one mode against its amplitude.

found = fit_free_decay(tip, sample_hz)
"""

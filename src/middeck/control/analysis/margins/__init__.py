"""Return ratios and where they cross: gain, phase, delay and disk margins."""

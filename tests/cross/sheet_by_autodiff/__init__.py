"""The data sheet computed by other means: exact beams, automatic differentiation, SciPy's Riccati solver."""

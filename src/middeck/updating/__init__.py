"""From tests on the ground to predictions for orbit: unknowns, residuals, refinement, extrapolation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

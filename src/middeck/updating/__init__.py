"""From tests on the ground to what will happen in orbit: unknowns, residuals, refinement, extrapolation."""

"""Documents of refinements: tests on the ground, unknowns, and requested predictions."""

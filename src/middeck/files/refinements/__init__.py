"""Documents of refinements: tests on the ground, unknowns, and what is to be predicted."""

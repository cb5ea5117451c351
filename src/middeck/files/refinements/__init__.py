"""Documents of refinements: tests on the ground, what may change to fit them, what is to be known."""

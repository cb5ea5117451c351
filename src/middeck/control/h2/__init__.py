"""The quadratic cost of a closed loop, its gradient, and laws of a given form."""

"""Linear-quadratic Gaussian designs: weights, filter, regulator and shaping filters."""

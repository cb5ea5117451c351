"""Linear-quadratic Gaussian designs: weights, filter, regulator, shaping filters and topologies."""

"""From modes to a plant: ports, damping, and the residual of truncated modes."""

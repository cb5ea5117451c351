"""From a start to a fit: costs, bounds, likelihood, and warnings."""

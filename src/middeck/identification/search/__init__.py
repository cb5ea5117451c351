"""From a start to a fit: costs, bounds, likelihood, and what warns."""

"""Uncertainty of a fit: covariance, intervals, bounds, sets of models, drift, expected accuracy."""

"""A measurement model fitted to a frequency response: starts, search, weights, order, doubts."""

"""How far a fit can be trusted: covariance, intervals, bounds, sets of models, drift, what to expect."""

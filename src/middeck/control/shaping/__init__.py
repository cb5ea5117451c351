"""Classical shaping of a compensator: leads, lags, notches and roll-off in series."""

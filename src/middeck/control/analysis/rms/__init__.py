"""Closed-loop responses and their rms, delays exact."""

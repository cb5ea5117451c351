"""Predictions of compensators where they cannot be tested."""

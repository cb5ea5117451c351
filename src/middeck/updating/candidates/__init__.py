"""Candidate tests, and the uncertainty that each would leave."""

"""Exact derivatives of rest states, frequencies, shapes and plants in every named number."""

"""Promises: their plans, the sealed documents, and their outcomes."""

"""Promises: what is promised, the sealed document, and what came of it."""

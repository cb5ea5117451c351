"""Environments: the form of their files, and what is wrong with them."""

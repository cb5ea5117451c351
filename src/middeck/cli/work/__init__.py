"""Computations that several verbs share: excitations, fits of records, loops."""

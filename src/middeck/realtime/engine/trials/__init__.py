"""Packages on rigs: served rigs, trials in stages, trips from a record, timing."""

"""Test signals: designed for a band and for limits, and recognised in records.

signal = design_multisine((0.1, 60.0), 64.0, 256.0, Limits(rms=0.1), rng)
found = recognise_excitation(record)
steady = cut_periods(record)
"""

"""The cases of `benchmarks/identification.py`, one file each."""

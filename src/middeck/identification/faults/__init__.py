"""Faults of records: found and reported, not raised.

for fault in detect_faults(record):
    print(fault)
"""

"""Faults of records: found and reported, not raised.

for fault in detect_faults(record):
    print(fault)
"""

from middeck.identification.faults.detect import detect_faults

__all__ = ["detect_faults"]

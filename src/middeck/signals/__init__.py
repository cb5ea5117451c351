"""Samples and the ports that they belong to: records, test signals, faults."""

"""Frequency responses from records: whole periods, local models, averaged spectra; their scatter."""

"""Sampled control: direct design and emulation of continuous designs."""

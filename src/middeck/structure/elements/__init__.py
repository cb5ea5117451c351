"""Frames, beams and springs: energies with two exact derivatives."""

"""Bars, beams and rods: their sections and their ends."""

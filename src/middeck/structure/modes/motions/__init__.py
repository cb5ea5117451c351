"""Composition of a shape: rigid motions, strain of members and parts, motion as one beam."""

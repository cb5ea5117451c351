"""Figures from results, one file a figure; matplotlib is imported here and nowhere further in."""

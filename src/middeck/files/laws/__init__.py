"""Compensators and controller packages in files, and the packages that have tripped."""

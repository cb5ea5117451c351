"""Accuracy of a mode: members too stiff for matrices."""

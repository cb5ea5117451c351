"""Accuracy of a mode: the mesh, and members too stiff for matrices."""

"""Loops designed on a fit and measured on the rig: judgement, text and drawings for several chapters."""

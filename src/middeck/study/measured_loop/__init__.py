"""Loops designed on a fit and measured on the rig, as several chapters judge, tell and draw them."""

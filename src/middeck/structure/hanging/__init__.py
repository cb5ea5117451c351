"""Attitude of an article on its devices, which `rest` has tuned: levelling, warnings, friction."""

"""Devices tuned to their load, how an article hangs on them, and their friction."""

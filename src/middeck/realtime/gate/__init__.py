"""The steps before a controller package may run."""

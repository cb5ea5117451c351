"""Plants: linear models with named ports, their responses and their modes."""

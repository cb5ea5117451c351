"""Measurements beside the model's values: modes, responses, sag."""

"""The measurement model: poles, constants and delays; its channels and its simulation."""

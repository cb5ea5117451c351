"""The measurement model: poles, constants and delays; its channels, its simulation; and a general descent."""

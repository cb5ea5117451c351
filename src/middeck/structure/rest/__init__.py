"""Rest state of an article in an environment, its suspension tuned."""

"""Where an article comes to rest in an environment, its suspension tuned."""

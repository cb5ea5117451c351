"""Kind and name of each mode: suspension, pendulum or flexible, and what it does."""

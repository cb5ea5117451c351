"""Kind and name of each mode: suspension, pendulum or flexible, and its motion."""

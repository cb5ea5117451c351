"""Effects of gravity on each mode, and modes followed while gravity changes."""

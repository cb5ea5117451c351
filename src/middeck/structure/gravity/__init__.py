"""What gravity does to each mode, and modes followed while it changes."""

"""From what was refined on the ground to another environment, above all orbit."""

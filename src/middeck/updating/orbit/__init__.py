"""From a refinement on the ground to another environment, above all orbit."""

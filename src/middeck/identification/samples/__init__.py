"""A measurement model fitted to the samples of a record that has no periods, and simulated on them."""

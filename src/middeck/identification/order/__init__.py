"""Number of states: races between orders, missing modes, stabilisation."""

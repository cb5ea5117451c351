"""How many states: races between orders, missing modes, stabilisation."""

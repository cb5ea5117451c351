"""How many states: races between orders, modes that are lacking, stabilisation."""

"""The designs: multi-model, minimax by exchange, sensitivity-weighted, Popov."""

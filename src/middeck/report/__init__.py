"""One page of a study that stands alone: figures, one sentence each, and the numbers under them."""

"""Mass, size and plausibility of an article, before anything is solved."""

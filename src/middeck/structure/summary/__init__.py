"""Mass, size and doubts of an article, before anything is solved."""

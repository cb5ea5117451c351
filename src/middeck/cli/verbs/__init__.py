"""One module per verb, each with its click command as ``verb``; the work is imported when the verb runs."""

"""What is given: articles, environments, and what is wrong with them before anything is computed."""

"""What is read from modes: drawings, results of components, and which of them bend."""

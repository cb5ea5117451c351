"""What a refinement may change, of the article and of the loop."""

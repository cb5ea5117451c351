"""What was measured beside what the article gives: modes, responses, sag."""

"""What an engine drives: articles stepped in C or in Python, rigs behind datagrams."""

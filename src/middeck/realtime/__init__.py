"""Laws at a sampling rate, and the rigs they run on."""

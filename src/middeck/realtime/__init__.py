"""Control laws on their way to a computer: packages, generated C and the gate."""

"""What engine and supervisor share: settings, monitors, commands, the mapped file."""

"""How an article hangs on its devices, which `rest` has tuned: attitude, levelling, warnings, friction."""

"""Hardware that is not there: sensors, arms and bags that speak the real protocols, and faults on purpose."""

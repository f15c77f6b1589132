"""Rules that take the time as an argument, and touch no port, driver or thread."""

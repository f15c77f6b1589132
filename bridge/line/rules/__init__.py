"""Rules: time is an argument, and they use no port, driver or thread."""

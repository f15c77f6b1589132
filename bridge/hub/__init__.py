"""The main thread's work on reports from lines and on commands from the broker."""

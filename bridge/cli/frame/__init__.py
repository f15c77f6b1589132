"""What all commands share: usage, signals, log, terminal, questions."""

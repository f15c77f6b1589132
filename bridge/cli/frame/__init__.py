"""The common parts of all commands: usage, signals, log, terminal, questions."""

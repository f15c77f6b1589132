"""docs/commands/: a page a command, made of the very words that `--help` prints."""

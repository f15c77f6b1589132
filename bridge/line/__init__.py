"""The work on a line: what is polled next, what a reply means, how a command is carried out."""

"""The work on a line: the next poll, the meaning of a reply, the execution of a command."""

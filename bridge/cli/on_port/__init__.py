"""Commands that open a port themselves."""

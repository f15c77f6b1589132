"""README and docs, pasted line by line on a fresh machine."""

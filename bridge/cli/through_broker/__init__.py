"""Commands that ask the running bridge through the broker."""

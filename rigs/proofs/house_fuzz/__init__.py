"""The fuzz of a whole house: the real program on a virtual clock, and an oracle that watches it."""

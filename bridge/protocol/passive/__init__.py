"""Reads along on a line: which frames pass there, in which direction, and what they mean."""

"""Listens on a line: finds the frames, their direction and their meaning."""

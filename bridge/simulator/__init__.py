"""Simulated modules on a line: a second opinion that shares no code with the codecs."""

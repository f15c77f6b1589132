"""A release, with everything but its publication."""

"""Builds and runs the bridge, and answers requests."""

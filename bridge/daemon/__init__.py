"""The composition root, and the desks that answer requests."""

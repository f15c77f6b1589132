"""Ports that carry bytes with a deadline, and the bus that makes exchanges of them."""

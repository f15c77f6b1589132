"""Ports that carry bytes with a deadline, and the bus that makes one exchange of them."""

"""What is done to a panel with a laptop, before there is a bridge: who is there, one at a time."""

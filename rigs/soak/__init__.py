"""The soak: the daemon for an hour in a house where everything goes wrong by turns."""

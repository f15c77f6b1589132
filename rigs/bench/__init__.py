"""The benchmark: the bridge and a bare loop against what the wire itself allows."""

"""Measures what real modules do, against what the bridge assumes. Reads alone, but for `output`."""

"""The panel in a real browser: `make test-web`."""

"""The configuration: YAML in, frozen dataclasses out, every problem at once with its line."""

"""The configuration: YAML into frozen dataclasses; each problem is reported with its line."""

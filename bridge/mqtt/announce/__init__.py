"""All that Home Assistant is told."""

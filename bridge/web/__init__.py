"""The panel in the browser: a second listener beside MQTT, and a second way for commands."""

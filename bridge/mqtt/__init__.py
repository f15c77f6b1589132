"""Topics, payloads and discovery (all pure), and the MQTT client."""

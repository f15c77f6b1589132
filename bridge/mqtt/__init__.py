"""Topics, payloads and discovery (all pure), and the client that carries them."""

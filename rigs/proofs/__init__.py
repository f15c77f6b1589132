"""The proofs behind docs/safety.md: each injects one failure of the field and counts."""

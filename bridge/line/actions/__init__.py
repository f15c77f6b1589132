"""The actions that use the bus: contact, polls, writes, covers."""

"""What talks on the bus: contact, polls, writes, covers."""

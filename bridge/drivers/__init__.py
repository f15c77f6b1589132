"""What a DIO100 or a DO100 can do, in requests of each protocol."""

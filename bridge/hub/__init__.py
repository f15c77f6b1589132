"""What the main thread does with what lines report and brokers ask."""

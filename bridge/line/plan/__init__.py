"""What is read next. Pure: time is an argument."""

"""The plan: what is read next. Pure: time is an argument."""

"""What a person sees and presses at a terminal: the panel of simulated modules."""

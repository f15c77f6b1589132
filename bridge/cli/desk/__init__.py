"""The panel of simulated modules at a terminal."""

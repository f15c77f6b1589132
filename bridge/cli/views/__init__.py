"""Views of results, for people and for programs."""

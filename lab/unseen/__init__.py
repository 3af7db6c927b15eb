"""People who sit as the library does not know."""

"""What only measures and tests the program: a question, a file, a command. See ``README.md``."""

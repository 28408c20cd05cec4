"""Coverage-guided fuzzing of every reader and port (`make fuzz`)."""

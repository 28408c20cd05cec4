"""Access: who may use a running Mindstage, how much of it, and what a text from outside may name."""

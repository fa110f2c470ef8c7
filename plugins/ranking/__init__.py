"""Frozen sequences, submissions of others, and the public ranking."""

"""Names of what the stages of a suite's jobs leave for each other."""

SEQUENCE = "sequence"
RESULT = "result.json"
"""A file whose text travels back with the job's outcome."""

"""The verbs `archive`, `submission` and `ranking`."""

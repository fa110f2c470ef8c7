"""Sequences frozen as files that others fetch, verify and unpack."""

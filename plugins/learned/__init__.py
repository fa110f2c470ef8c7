"""Learned extractions of depth, and their training."""

"""Robustness studies: one thing is perturbed by growing amounts, and every method is scored."""

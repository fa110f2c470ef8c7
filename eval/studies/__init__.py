"""Robustness studies: one thing is spoilt by growing amounts, and every method is scored."""

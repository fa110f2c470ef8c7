"""The gate: is this worse than the baseline?"""

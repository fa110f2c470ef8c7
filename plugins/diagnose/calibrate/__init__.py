"""Refines calibration, clocks and hand-eye from events and poses alone."""

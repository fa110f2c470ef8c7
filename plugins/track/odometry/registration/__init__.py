"""Batches of events against the lines of a map, and map points against lines of events."""

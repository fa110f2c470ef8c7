"""Learned extraction: a small network that reads the votes around a pixel; see `extract`."""

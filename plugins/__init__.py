"""Capabilities that stand beside the core, each in a folder of its own, joined by entry points."""

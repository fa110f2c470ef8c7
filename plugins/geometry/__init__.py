"""Geometry of a whole sequence against exact truth: clouds, meshes and splats made from events."""

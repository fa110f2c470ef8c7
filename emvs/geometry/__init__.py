"""Frames, cameras, rigs, trajectories, warps."""

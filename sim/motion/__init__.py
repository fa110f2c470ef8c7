"""Motion of the rig: smooth curves, heads, recorded trajectories."""

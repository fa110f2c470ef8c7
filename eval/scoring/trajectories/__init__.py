"""Trajectories against true ones: how poses are paired, aligned and scored."""

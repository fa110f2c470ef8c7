"""The mapper: events, cameras, trajectories, ray density fusion and depth extraction."""

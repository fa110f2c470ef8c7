"""What a mapper reads: events, cameras, rigs, trajectories, sequences on disk."""

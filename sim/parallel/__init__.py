"""Long simulations: jobs, worker processes, checkpoints."""

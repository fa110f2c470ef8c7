"""Training of the learned extraction: its sequences, its samples, its network in torch."""

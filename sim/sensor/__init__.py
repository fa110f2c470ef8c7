"""From intensity to events: the ideal model and what a real sensor adds."""

"""A recording's sensor: parameters fitted to it, and how real a simulated one looks."""

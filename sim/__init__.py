"""The simulator: a rig of event cameras moving through a MuJoCo scene."""

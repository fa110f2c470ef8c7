"""Events, frames and depth in one pixel grid, by per-pixel depth, poses and calibrations."""

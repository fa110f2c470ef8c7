"""From a scene to linear intensity and metric depth, through any lens."""

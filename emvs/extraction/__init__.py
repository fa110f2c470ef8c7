"""From the maxima of a sweep to depth maps: one strategy a module, and the method that it makes."""

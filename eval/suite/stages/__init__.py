"""The stages of a suite's jobs, a module each, so that each has a version of its own code."""

"""The stages of jobs, a module each, so that each has a version of its own code.

A suite, a study and a run are made of the same: a scene to a sequence, a sequence to maps, maps
and ground truth to scores.
"""

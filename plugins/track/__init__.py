"""Poses from events alone: the tracker, its verb, its stage of jobs and its page."""

"""The first stage of a study's jobs, where it changes the scene; the others are a suite's."""

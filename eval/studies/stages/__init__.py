"""The stages of a study's jobs: a changed scene is simulated, a perturbed recording is mapped."""

"""The pages of a run, a comparison and a study."""

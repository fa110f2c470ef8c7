"""What may be wrong with a recording, before or instead of a map that is garbage."""

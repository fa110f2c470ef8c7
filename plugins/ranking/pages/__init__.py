"""The page of a public ranking: who is ahead, where, and at what cost."""

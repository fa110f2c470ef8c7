"""The public ranking: results of suites in small, and who is ahead, how surely."""

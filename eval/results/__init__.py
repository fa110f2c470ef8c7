"""One table of results, with what made its numbers: read and written here, whoever made it."""

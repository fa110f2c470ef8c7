"""Results side by side: what may be compared, how it differs, how sure that is, and the page."""

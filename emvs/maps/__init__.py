"""Map folders: written, read, grown window by window, merged."""

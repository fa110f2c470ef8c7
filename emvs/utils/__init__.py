"""What everything else stands on: atomic files, progress, threads, versions."""

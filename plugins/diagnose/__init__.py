"""What may be wrong with a recording, and what mends it: check, calibrate, fit, realism."""

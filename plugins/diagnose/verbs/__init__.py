"""The verbs `check`, `calibrate`, `fit` and `realism`."""

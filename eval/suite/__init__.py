"""Suites: frozen sets of cases, run as jobs."""

"""The verbs of the command line, a module each; importing one registers it.

Modules here import what is light at their top and what is heavy inside their function: help must
come at once.
"""

"""Poses from events alone: tracked against maps, which are made on the poses found so far."""

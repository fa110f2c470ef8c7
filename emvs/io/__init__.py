"""Readers of the field's data sets: each opens a recording as its publisher lays it out."""

from emvs.io.recognise import open_recording

__all__ = ["open_recording"]

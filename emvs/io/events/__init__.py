"""Event streams in every format of the field: open any of them, write most of them.

`open_events(path)` recognises a file by its content; `write_events` writes one, streaming, and
refuses what the format cannot hold. `FORMATS` says what that is.
"""

from emvs.io.events.contract import EventReader, Limits, Progress, Streams
from emvs.io.events.formats import FORMATS, Format
from emvs.io.events.recognise import open_events
from emvs.io.events.write import write_events

__all__ = [
    "FORMATS",
    "EventReader",
    "Format",
    "Limits",
    "Progress",
    "Streams",
    "open_events",
    "write_events",
]

"""Simulate, map and score event-based multi-view stereo: the names for users of the library.

    import eventsweep as es

    recording = es.open_recording("out/desk/sequence")
    result = es.map_window(recording, es.MapperConfig(methods=("Alg1/H",)))
    print(es.score(result, recording))

The names and their places are listed in `__init__.pyi`; each is imported when it is first used, so
importing this package costs nothing. Paths may be strings everywhere, and bad input raises
`InputError` with one line.
"""

import ast as _ast
from pathlib import Path as _Path

import lazy_loader as _lazy_loader

_places: dict[str, list[str]] = {}
for _line in _ast.parse(_Path(__file__).with_suffix(".pyi").read_text("utf-8")).body:
    if isinstance(_line, _ast.ImportFrom):
        _places.setdefault(_line.module or "", []).extend(name.name for name in _line.names)
# A plug-in whose folder was taken out of a checkout takes its names along.
_found = {
    place: names
    for place, names in _places.items()
    if not place.startswith("plugins.") or _Path(__path__[0], *place.split(".")[:2]).is_dir()
}
__getattr__, __dir__, __all__ = _lazy_loader.attach(__name__, _found.pop("", []), _found)

"""Simulate, map and score event-based multi-view stereo: the names for users of the library.

    import eventsweep as es

    recording = es.open_recording("out/desk/sequence")
    result = es.map_window(recording, es.MapperConfig(methods=("Alg1/H",)))
    print(es.score(result, recording))

The names and their places are listed in `__init__.pyi`; each is imported when it is first used, so
importing this package costs nothing. Paths may be strings everywhere, and bad input raises
`InputError` with one line.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

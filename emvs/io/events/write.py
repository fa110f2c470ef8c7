"""Writes event files: streaming, atomic, refusing what a format cannot hold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from emvs.data.events import Events
from emvs.errors import InputError
from emvs.io.events.contract import Checker, Progress, Streams, only_stream
from emvs.io.events.formats import FORMATS
from emvs.io.events.writer import StreamWriter
from emvs.utils.files import atomic_path


def write_events(
    path: Path,
    format: str,  # noqa: A002 - the caller's word for it
    width_px: int,
    height_px: int,
    streams: Streams,
    progress: Progress | None = None,
) -> int:
    """Writes streams of events into one file; memory holds a packet per stream.

    Args:
        path: the file; it appears whole or not at all, and replaces one that is there.
        format: a name in `FORMATS`.
        width_px: sensor width.
        height_px: sensor height.
        streams: packets per stream; with several streams, written in the order of time.
        progress: told the number of events written so far, after each packet.

    Returns:
        The number of events written.

    Raises:
        InputError: an unknown format, or an event, a sensor or a number of streams that the
            format cannot hold: nothing is written then.
    """
    entry = FORMATS.get(format)
    if entry is None or not entry.writes:
        known = ", ".join(name for name, known in FORMATS.items() if known.writes)
        raise InputError(f"{path}: format {format!r} cannot be written; choose one of {known}")
    if entry.limits.streams == 1:
        only_stream(path, streams)
    if not 1 <= len(streams) <= entry.limits.streams:
        raise InputError(
            f"{path}: {len(streams)} streams; {format} holds 1 to {entry.limits.streams}"
        )
    check = Checker(path, entry.limits, width_px, height_px)
    with (
        atomic_path(path) as partial,
        _writer(partial, format, width_px, height_px, tuple(streams)) as writer,
    ):
        for stream, events in _in_time_order(streams):
            writer.append(stream, check(stream, events))
            if progress is not None:
                progress(check.count)
    return check.count


def _in_time_order(streams: Streams) -> Iterator[tuple[str, Events]]:
    """Packets of all streams, always the one that ends first."""
    rest = {name: iter(packets) for name, packets in streams.items()}
    heads: dict[str, Events] = {}
    while rest or heads:
        for name in [name for name in rest if name not in heads]:
            packet = _next(rest[name])
            if packet is None:
                del rest[name]
            else:
                heads[name] = packet
        if heads:
            name = min(heads, key=lambda name: int(heads[name].t_us[-1]))
            yield name, heads.pop(name)


def _next(packets: Iterable[Events]) -> Events | None:
    return next((packet for packet in packets if len(packet)), None)


def _writer(
    path: Path,
    kind: str,
    width_px: int,
    height_px: int,
    names: Sequence[str],
) -> StreamWriter:
    from emvs.io.events import hdf5_writer, npz_writer, raw_writer, text_writer

    match kind:
        case "evt2" | "evt3":
            return raw_writer.RawWriter(path, kind, width_px, height_px)
        case "text" | "esim-text" | "csv":
            return text_writer.TextWriter(path, kind, width_px, height_px)
        case "npz":
            return npz_writer.NpzWriter(path, width_px, height_px)
        case "dsec":
            return hdf5_writer.DsecWriter(path, width_px, height_px)
        case "tumvie":
            return hdf5_writer.TumvieWriter(path)
        case "mvsec":
            return hdf5_writer.MvsecWriter(path, names)
        case "aedat4":
            from emvs.io.events.aedat4_writer import Aedat4Writer

            return Aedat4Writer(path, width_px, height_px, names)
        case _:
            from emvs.io.events.rosbag_writer import RosbagWriter

            return RosbagWriter(path, width_px, height_px, names)

"""Events as columns of a Parquet table, read by pyarrow (extra `parquet`)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from eventsweep.emvs.data.events import Events, Numbers, to_events
from eventsweep.emvs.errors import InputError, quoted, refused, shown
from eventsweep.emvs.formats.blocks import BlockReader
from eventsweep.emvs.formats.prophesee import STREAM, opened
from eventsweep.emvs.formats.tables.columns import UNITS_S, ColumnMap, agreed_unit_s, by_names
from eventsweep.emvs.utils.plugins import extra_module

_ROWS = 1 << 18


class ParquetReader(BlockReader):
    """A Parquet file: one stream, `events`.

    A block is a batch of a row group; a row group is read from its start to find one again. Columns
    are as stated, or what their names say; time stamps of Arrow's own type say their unit.
    """

    format = "parquet"

    def __init__(self, path: Path, columns: ColumnMap | None = None) -> None:
        super().__init__(Path(path), (STREAM,))
        purpose = f"{self.path}: Parquet needs pyarrow"
        self._parquet = extra_module("pyarrow.parquet", purpose, "parquet")
        with self._opened() as table:
            schema, self._rows = table.schema_arrow, table.metadata.num_rows
            self._groups = [
                table.metadata.row_group(k).num_rows for k in range(table.num_row_groups)
            ]
        if columns is None or not columns.x:
            self._names, unit_s = by_names(str(self.path), schema.names)
        else:
            self._names, unit_s = columns.addresses, None
        self._unit_s = agreed_unit_s(str(self.path), unit_s, columns)
        for name in self._names.values():
            self._check(schema, name)
        if sum(self._groups) != self._rows:
            raise InputError(
                f"{self.path}: {self._rows} rows declared, {sum(self._groups)} present; the file "
                "is damaged, download it again"
            )

    def scan(self, _stream: str) -> Iterator[tuple[Any, Events]]:
        """Reads the row groups from front to back."""
        before = 0
        with self._opened() as table:
            for group, rows in enumerate(self._groups):
                for k, events in enumerate(self._batches(table, group)):
                    yield (group, k, min(before + (k + 1) * _ROWS, before + rows)), events
                before += rows

    def load(self, _stream: str, place: Any) -> Events:
        """Reads one batch."""
        with self._opened() as table:
            for k, events in enumerate(self._batches(table, place[0])):
                if k == place[1]:
                    return events
        raise InputError(f"{self.path}: changed while it was read; open it again")

    def share_before(self, _stream: str, place: Any) -> float:
        """Which share of the rows ends with a block."""
        return float(place[2] / max(1, self._rows))

    def _batches(self, table: Any, group: int) -> Iterator[Events]:
        """The events of a row group; all rows that it declares must be there."""
        names = list(dict.fromkeys(self._names.values()))
        done = 0
        for batch in table.iter_batches(_ROWS, [group], names, use_threads=False):
            where = f"{self.path}, row group {group}, rows {done} to {done + batch.num_rows}"
            done += batch.num_rows
            x, y, t, p = (self._numbers(where, batch, self._names[name]) for name in "xytp")
            kind = batch.schema.field(self._names["t"]).type
            is_stamp = str(kind).startswith("timestamp")
            yield to_events(where, x, y, t, p, UNITS_S[kind.unit] if is_stamp else self._unit_s)
        if done != self._groups[group]:
            raise InputError(
                f"{self.path}, row group {group}: {done} rows of {self._groups[group]}; the file "
                "is damaged, download it again"
            )

    def _numbers(self, where: str, batch: Any, name: str) -> Numbers:
        column = batch.column(batch.schema.get_field_index(name))
        column.validate(full=True)
        if column.null_count:
            raise InputError(
                f"{where}: {column.null_count} values of {quoted(name)} are missing; remove "
                "those rows"
            )
        values: Numbers = column.to_numpy(zero_copy_only=False)
        return values.astype(np.int64) if values.dtype.kind == "M" else values

    def _check(self, schema: Any, name: str) -> None:
        if schema.names.count(name) != 1:
            raise InputError(
                f"{self.path}: {schema.names.count(name)} columns {quoted(name)}; needs one; there "
                f"are {quoted(*schema.names)}"
            )
        kind = str(schema.field(name).type)
        time = kind.startswith("timestamp[") and name == self._names["t"]
        if not (time or kind in _NUMBERS):
            raise InputError(
                f"{self.path}, column {quoted(name)}: of type {shown(kind)}; needs plain numbers"
            )

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        """The table; what the library says of damage becomes one line."""
        what = f"{self.path}: not a complete Parquet file"
        # The library, its codecs and damaged names raise any exception.
        with refused(what, Exception, cure="; save it again"), opened(self.path) as file:
            yield self._parquet.ParquetFile(file, page_checksum_verification=True)


_NUMBERS = {
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
    *("bool", "halffloat", "float", "double"),
}

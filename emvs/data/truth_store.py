"""Ground truth on disk: images and numbers of one camera at chosen times, in HDF5.

Depth and intensity are always there; what else there is, `OPTIONAL` names. Each image is a
compressed chunk of its own, so reading one reads nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import hdf5plugin
import numpy as np
from numpy.typing import NDArray

from emvs.data.hdf5 import COMPRESSION, Hdf5Writer, open_hdf5
from emvs.data.hdf5_checks import check_dataset
from emvs.errors import InputError

Image = NDArray[Any]

_ALWAYS: dict[str, np.dtype[Any]] = {
    "depth_m": np.dtype(np.float32),
    "intensity": np.dtype(np.uint8),
}
OPTIONAL: dict[str, np.dtype[Any]] = {
    "flow_px": np.dtype(np.float32),
    "segmentation": np.dtype(np.int32),
    "boundary": np.dtype(np.uint8),
    "twist": np.dtype(np.float64),
    "view_depth_m": np.dtype(np.float32),
}
"""Optional data sets and their types; docs/truth.md says what they mean."""

_SHUFFLED = hdf5plugin.Blosc(cname="lz4", clevel=5, shuffle=hdf5plugin.Blosc.SHUFFLE)


class TruthWriter:
    """Appends ground truth to a file, one time after the other."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._optional: tuple[str, ...] | None = None
        self._hdf5 = Hdf5Writer(path)
        self._file = self._hdf5.file
        self._file.create_dataset("t_us", (0,), np.int64, maxshape=(None,), chunks=(1024,))
        for name in _ALWAYS:
            self._create(name, (height_px, width_px))

    def append(
        self,
        t_us: int,
        depth_m: NDArray[np.float32],
        intensity: NDArray[np.uint8],
        optional: Mapping[str, Image] | None = None,
    ) -> None:
        """Adds one time.

        Args:
            t_us: after the time before, µs.
            depth_m: (H, W) z-depth, m.
            intensity: (H, W) linear intensity, 0..255.
            optional: data sets named in `OPTIONAL`, the same ones at every time.

        Raises:
            InputError: an unknown data set, or not those of the times before.
        """
        more = self._checked(optional or {})
        index = self._file["t_us"].shape[0]
        values: dict[str, Any] = {"t_us": t_us, "depth_m": depth_m, "intensity": intensity, **more}
        for name, value in values.items():
            dataset = self._file[name]
            dataset.resize(index + 1, axis=0)
            dataset[index] = value
        self._hdf5.check()

    def close(self) -> None:
        """Closes the file."""
        self._hdf5.close()

    def __enter__(self) -> TruthWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _create(self, name: str, shape: tuple[int, ...]) -> None:
        kind = {**_ALWAYS, **OPTIONAL}[name]
        self._file.create_dataset(
            name, (0, *shape), kind, maxshape=(None, *shape), chunks=(1, *shape),
            **COMPRESSION.get(kind, _SHUFFLED),
        )  # fmt: skip

    def _checked(self, optional: Mapping[str, Image]) -> dict[str, Image]:
        if self._optional is None:
            unknown = set(optional) - set(OPTIONAL)
            if unknown:
                raise InputError(
                    f"ground truth {sorted(unknown)} is unknown: there are {', '.join(OPTIONAL)}"
                )
            self._optional = tuple(name for name in OPTIONAL if name in optional)
            for name in self._optional:
                self._create(name, optional[name].shape)
        if set(optional) != set(self._optional):
            raise InputError(
                f"ground truth with {sorted(optional)} after times with "
                f"{sorted(self._optional)}: give the same data sets at every time"
            )
        return {name: optional[name] for name in self._optional}


class TruthReader:
    """Reads single ground-truth images.

    Raises:
        InputError: a missing or truncated file, or one of another layout.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        with open_hdf5(self.path) as file:
            self.optional = tuple(name for name in OPTIONAL if name in file)
            for name in ("t_us", *_ALWAYS, *self.optional):
                check_dataset(self.path, file[name])
            self.t_us: NDArray[np.int64] = file["t_us"][:]

    def depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in metres at a stored time; not finite where nothing is seen."""
        return self._read("depth_m", t_us).astype(np.float32, copy=False)

    def intensity(self, t_us: int) -> NDArray[np.uint8]:
        """(H, W) linear intensity, 0..255, at a stored time."""
        return self._read("intensity", t_us).astype(np.uint8, copy=False)

    def read(self, name: str, t_us: int) -> Image:
        """An optional data set at a stored time, see `OPTIONAL`.

        Raises:
            InputError: it was not stored, or not at that time.
        """
        if name not in self.optional:
            stored = ", ".join(self.optional) or "none of the optional ones"
            raise InputError(
                f"{self.path}: has no {name} (it has: {stored}); simulate with it in `truth`"
            )
        return self._read(name, t_us)

    def times(self) -> Iterator[tuple[int, dict[str, Image]]]:
        """Every stored time with all of its data, in order."""
        for t_us in self.t_us.tolist():
            yield t_us, {name: self._read(name, t_us) for name in (*_ALWAYS, *self.optional)}

    def _read(self, name: str, t_us: int) -> Image:
        found = np.flatnonzero(self.t_us == t_us)
        if not found.size:
            nearest = self.t_us[np.argmin(np.abs(self.t_us - t_us))] if len(self.t_us) else "none"
            raise InputError(
                f"{self.path}: no ground truth at {t_us} µs (nearest: {nearest}); put the "
                "reference view on a stored time, or simulate with another truth interval"
            )
        with open_hdf5(self.path) as file:
            image: Image = file[name][int(found[0])]
        return image

"""Ground truth on disk: z-depth and intensity images of one camera at chosen times, in HDF5."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from emvs.data.hdf5 import COMPRESSION, Hdf5Writer, open_hdf5
from emvs.errors import InputError


class TruthWriter:
    """Appends ground-truth images to a file, one image at a time."""

    def __init__(self, path: Path, width_px: int, height_px: int) -> None:
        self._hdf5 = Hdf5Writer(path)
        self._file = self._hdf5.file
        shape = (height_px, width_px)
        self._file.create_dataset("t_us", (0,), np.int64, maxshape=(None,), chunks=(1024,))
        for name, kind in (("depth_m", np.float32), ("intensity", np.uint8)):
            self._file.create_dataset(
                name, (0, *shape), kind, maxshape=(None, *shape), chunks=(1, *shape),
                **COMPRESSION[np.dtype(kind)],
            )  # fmt: skip

    def append(self, t_us: int, depth_m: NDArray[np.float32], intensity: NDArray[np.uint8]) -> None:
        """Adds one time: (H, W) z-depth in metres and (H, W) linear intensity, 0..255."""
        index = self._file["t_us"].shape[0]
        for name, value in (("t_us", t_us), ("depth_m", depth_m), ("intensity", intensity)):
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


class TruthReader:
    """Reads single ground-truth images.

    Raises:
        InputError: a missing or truncated file, or one of another layout.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        with open_hdf5(self.path) as file:
            self.t_us: NDArray[np.int64] = file["t_us"][:]

    def depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in metres at a stored time; not finite where nothing is seen."""
        return self._read("depth_m", t_us).astype(np.float32, copy=False)

    def intensity(self, t_us: int) -> NDArray[np.uint8]:
        """(H, W) linear intensity, 0..255, at a stored time."""
        return self._read("intensity", t_us).astype(np.uint8, copy=False)

    def _read(self, name: str, t_us: int) -> NDArray[np.generic]:
        found = np.flatnonzero(self.t_us == t_us)
        if not found.size:
            nearest = self.t_us[np.argmin(np.abs(self.t_us - t_us))] if len(self.t_us) else "none"
            raise InputError(
                f"{self.path}: no ground truth at {t_us} µs (nearest: {nearest}); put the "
                "reference view on a stored time, or simulate with another truth interval"
            )
        with open_hdf5(self.path) as file:
            image: NDArray[np.generic] = file[name][int(found[0])]
        return image

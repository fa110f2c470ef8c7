"""The hidden folder of unfinished work beside a target: killed at any moment, it goes on there."""

from __future__ import annotations

import fcntl
import json
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

from emvs.errors import InputError
from emvs.geometry.rig import Rig
from emvs.utils.files import atomic_path
from sim.parts import Part, PartWriter, State, whole_part

Notice = Callable[[str], None]
"""Called with one line for people to read."""

_KEY, _LOCK = "job.json", "lock"
_FORMAT = 2
# A damaged part costs what follows from it, and with it the work back to the last state.
_STATES_KEPT = 3


class Stopped(InputError):
    """Something outside the input stopped the work; run again to go on."""


class WorkFolder:
    """A context that holds the work folder of one target, and only one process at a time.

    Left with an error, it stays for the next run if a part is finished, and goes if there is none
    or if the input was wrong, because then what is done is of no use. The target is never touched.

    Args:
        out: the target.
        key: says what is being made; work under another key is refused.
        rig: its cameras.
        resume: go on from what is there; otherwise it is discarded.
        notice: told when work is taken up or found damaged.

    Raises:
        InputError: another process works on the target, the folder cannot be made, or what is
            there was made with other parameters.
    """

    def __init__(self, out: Path, key: str, rig: Rig, *, resume: bool, notice: Notice) -> None:
        self.path = work_path(out)
        self.parts: list[Part] = []
        self._out, self._key, self._rig = out, key, rig
        self._resume, self._notice = resume, notice
        self._open: PartWriter | None = None

    def __enter__(self) -> WorkFolder:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = (self.path / _LOCK).open("w")
        except OSError as error:
            raise InputError(
                f"cannot work in {self.path.parent} ({error.strerror}): choose another output"
            ) from error
        try:
            self._take_lock()
            self._take_up()
        except BaseException:
            self._lock.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._open is not None:
            self._open.close()
            shutil.rmtree(self._open.path, ignore_errors=True)
        wrong = isinstance(error, InputError) and not isinstance(error, Stopped)
        if error is None or wrong or not self.parts:
            shutil.rmtree(self.path, ignore_errors=True)
        self._lock.close()

    @property
    def next_chunk(self) -> int:
        """The first chunk that is not done."""
        return self.parts[-1].end_chunk if self.parts else 0

    @property
    def writer(self) -> PartWriter:
        """The part that is being written."""
        if self._open is None:
            name = f"{len(self.parts):06d}.partial"
            self._open = PartWriter(self.path / name, self.next_chunk, self._rig)
        return self._open

    def commit(self, state: State, end_chunk: int, counts: Sequence[dict[str, int]] = ()) -> None:
        """Finishes the part that is being written, with the sensors' state behind it."""
        self.parts.append(self.writer.finish(state, end_chunk, counts))
        self._open = None
        for part in self.parts[-_STATES_KEPT - 1 : -_STATES_KEPT]:
            part.drop_state()

    def _take_lock(self) -> None:
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise InputError(
                f"{self._out}: another process is writing it: wait, or choose another output"
            ) from error

    def _take_up(self) -> None:
        self._remove_leftovers()
        job = self.path / _KEY
        wanted = {"format": _FORMAT, "key": self._key}
        if self._resume and job.exists():
            if json.loads(job.read_text(encoding="utf-8")) != wanted:
                raise InputError(
                    f"{self.path} holds unfinished work of other parameters, scene or versions: "
                    "finish it with those, or set resume=False to discard it"
                )
            self._find_parts()
            return
        for entry in self.path.iterdir():
            if entry.is_dir():
                shutil.rmtree(entry)
        with atomic_path(job) as partial:
            partial.write_text(json.dumps(wanted), encoding="utf-8")

    def _remove_leftovers(self) -> None:
        """What a killed process left of a part, or of putting the sequence together."""
        assembled = re.compile(rf"\.{re.escape(self._out.name)}\.\w{{8}}\.partial")
        beside = [p for p in self._out.parent.iterdir() if assembled.fullmatch(p.name)]
        for folder in (*self.path.glob("*.partial"), *beside):
            shutil.rmtree(folder, ignore_errors=True)

    def _find_parts(self) -> None:
        """The longest run of whole parts from the start that ends with a state."""
        found: list[Part] = []
        paths = sorted(path for path in self.path.iterdir() if path.is_dir())
        for path in paths:
            part = whole_part(path)
            if part is None or part.first_chunk != (found[-1].end_chunk if found else 0):
                self._notice(f"{path} is damaged: what follows from it is made again")
                break
            found.append(part)
        while found and not found[-1].has_state:
            found.pop()
        for path in paths[len(found) :]:
            shutil.rmtree(path)
        self.parts = found


def work_path(out: Path) -> Path:
    """Where the unfinished work of a target lies."""
    return out.parent / f".{out.name}.work"

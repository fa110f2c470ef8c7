"""Follows an object through the product, call by call.

Run: python tests/benchmarks call_trace [ROOT]

Two journeys: the `MapperConfig` of one small window through `map_window`, and the `Scene` of the
desk, 50 ms of it, through all that `run` does. A function *handles* the object where it

- is called with it (or another object of its class, such as a copy), also as `self`;
- is called with what holds it: in an attribute, an element, a closure or a bound argument;
- is called with a part of it, an attribute that is no plain number or text and was read before;
- reads one of its attributes; or returns it.

Each function counts where it does so first, as a reader reads it once. The modules of these
functions in order, those in a row counted once, are the way; a *return* is a step into a module
that was left before.

The checkout is run, not only read. Threads that begin meanwhile are followed, processes are not.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import groupby
from pathlib import Path
from types import CellType, FrameType, FunctionType, SimpleNamespace
from typing import Any

# what is needed -> where it is; `eventsweep.` stands before it in all but older checkouts
PLACES = {
    "map_window": "emvs.mapper",
    "MapperConfig": "emvs.config",
    "Camera": "emvs.geometry.camera",
    "Rig": "emvs.geometry.rig",
    "Trajectory": "emvs.geometry.trajectory",
    "Events": "emvs.data.events",
    "Scene": "sim.scene",
    "run_cases": "eval.pipeline",
    "write_report": "eval.report.run_page",
    "Settings": "eval.config",
}
METHODS = ("Alg1/H", "EMVS/cam0")
SIZE_PX = (64, 48)
DURATION_US = 100_000
SCENE, SCENE_S = "desk", 0.05

PACKAGES = ("emvs", "sim", "scenes", "eval", "eventsweep")
PLAIN = (bool, int, float, str, bytes)
LONG = 20  # elements of a list that are looked at
EMPTY = CellType()


def find(name: str) -> Any:
    """A name of the product, from its place."""
    place = PLACES[name]
    inside = importlib.util.find_spec(f"eventsweep.{place.partition('.')[0]}") is not None
    return getattr(importlib.import_module(f"eventsweep.{place}" if inside else place), name)


class Follower:
    """Notes, in order, the modules whose functions handle objects of one class.

    Attributes:
        steps: (module, function) of each function where it handles such an object first.
    """

    def __init__(self, root: Path, kind: type) -> None:
        self.steps: dict[tuple[str, str], None] = {}
        self._folders = tuple(f"{root}/{package}/" for package in PACKAGES)
        self._kind = kind
        self._parts: dict[int, Any] = {}  # kept, lest another object get the same id

    @contextmanager
    def following(self) -> Iterator[Follower]:
        """Follows all calls of this thread, and of those that begin meanwhile."""
        threading.setprofile(self._on_call)
        with self._watched_attributes():
            sys.setprofile(self._on_call)
            try:
                yield self
            finally:
                sys.setprofile(None)
                threading.setprofile(None)

    @contextmanager
    def _watched_attributes(self) -> Iterator[None]:
        """Lets the class tell who reads its attributes."""
        read = self._kind.__getattribute__

        def watched(one: Any, name: str) -> Any:
            value = read(one, name)
            if not name.startswith("_"):
                self._on_read(sys._getframe(1), value)
            return value

        self._kind.__getattribute__ = watched  # type: ignore[method-assign, assignment]
        try:
            yield
        finally:
            del self._kind.__getattribute__

    def _on_call(self, frame: FrameType, event: str, returned: Any) -> None:
        if event == "call" and self._is_ours(frame):
            # At the call a function's locals are its arguments, and what its closure holds.
            if any(self._carries(value) for value in list(frame.f_locals.values())):
                self._note(frame)
        elif event == "return" and isinstance(returned, self._kind) and self._is_ours(frame):
            self._note(frame)

    def _on_read(self, frame: FrameType, value: Any) -> None:
        if self._is_ours(frame):
            self._note(frame)
            if value is not None and not isinstance(value, PLAIN):
                self._parts[id(value)] = value

    def _is_ours(self, frame: FrameType) -> bool:
        """Whether this is a function of the product, and no module's body or comprehension."""
        code = frame.f_code
        return code.co_filename.startswith(self._folders) and not code.co_name.startswith("<")

    def _carries(self, value: Any) -> bool:
        if isinstance(value, (type, *PLAIN)):
            return False
        if isinstance(value, self._kind) or id(value) in self._parts:
            return True
        return any(isinstance(one, self._kind) for one in held_by(value))

    def _note(self, frame: FrameType) -> None:
        # Compiled kernels are dispatched in frames that do not say their module.
        if module := frame.f_globals.get("__name__"):
            self.steps.setdefault((module, frame.f_code.co_qualname))

    @property
    def way(self) -> list[str]:
        """The modules in order; none stands twice in a row."""
        return [module for module, _ in groupby(module for module, _ in self.steps)]

    @property
    def modules(self) -> int:
        """Distinct modules."""
        return len(set(self.way))

    @property
    def returns(self) -> int:
        """Steps into a module that was left before."""
        return len(self.way) - self.modules


def held_by(value: Any) -> list[Any]:
    """What a value holds one step down, where it can hold something of interest."""
    if isinstance(value, (tuple, list)):
        return list(value[:LONG])
    if isinstance(value, partial):
        return [*value.args, *value.keywords.values()]
    if isinstance(value, FunctionType):
        return [cell.cell_contents for cell in value.__closure__ or () if cell != EMPTY]
    if type(value).__module__.split(".")[0] in PACKAGES:
        return list(getattr(value, "__dict__", {}).values())
    return []


def tiny_recording() -> SimpleNamespace:
    """Two cameras that pass random points at constant speed; events of random pixels."""
    import numpy as np

    width_px, height_px = SIZE_PX
    camera = find("Camera")(width_px, height_px, 50.0, 50.0, width_px / 2, height_px / 2)
    T_body_right = np.eye(4)
    T_body_right[0, 3] = 0.1
    t_us = np.array([0, DURATION_US])
    path_m = np.array([[-0.05, 0, 0], [0.05, 0, 0]])
    streams = [_random_events(seed, 2_000) for seed in range(2)]
    return SimpleNamespace(
        name="points",
        rig=find("Rig")("pair", (camera, camera), (np.eye(4), T_body_right)),
        trajectory=find("Trajectory")(t_us, path_m, np.tile([0.0, 0, 0, 1], (2, 1))),
        depth_range_m=(0.5, 3.0),
        event_span_us=lambda camera: (0, DURATION_US - 1),
        events=lambda camera, t0_us, t1_us: streams[camera].between(t0_us, t1_us),
        frame=lambda camera, t_us: None,
    )


def _random_events(seed: int, count: int) -> Any:
    import numpy as np

    rng = np.random.default_rng(seed)
    x, y = (rng.integers(0, size, count).astype(np.uint16) for size in SIZE_PX)
    t_us = np.sort(rng.integers(0, DURATION_US, count))
    return find("Events")(x, y, t_us, rng.integers(0, 2, count).astype(np.uint8))


def follow_config(root: Path) -> Follower:
    """The mapper's parameters through one window."""
    map_window, recording = find("map_window"), tiny_recording()
    config = find("MapperConfig")(planes=10, methods=METHODS)
    return _followed(root, type(config), lambda: map_window(recording, config))


def follow_scene(root: Path) -> Follower:
    """A scene through everything that `run` does with it."""
    run_cases = find("run_cases")
    settings = find("Settings").model_validate(
        {"sim": {"duration_s": SCENE_S}, "map": {"methods": METHODS, "planes": 10}}
    )
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        return _followed(
            root,
            find("Scene"),
            lambda: run_cases([SCENE], out, settings, None, 0, finish=find("write_report")),
        )


def _followed(root: Path, kind: type, journey: Callable[[], Any]) -> Follower:
    with Follower(root, kind).following() as follower:
        journey()
    return follower


def report(title: str, followed: Follower) -> str:
    """The figures and the way, as Markdown."""
    counts = (
        f"{followed.modules} modules, {followed.returns} returns, {len(followed.steps)} functions"
    )
    return f"**{title}**: {counts}\n\n{' -> '.join(followed.way)}\n"


def main() -> None:
    """Follows both objects in the checkout named on the command line."""
    parser = argparse.ArgumentParser(description="Follows an object through the product.")
    parser.add_argument("root", type=Path, nargs="?", default=Path(__file__).resolve().parents[3])
    root = parser.parse_args().root.resolve()
    sys.path.insert(0, str(root))
    print(report("MapperConfig through map_window", follow_config(root)))  # noqa: T201
    print(report(f"Scene through run {SCENE}", follow_scene(root)))  # noqa: T201


if __name__ == "__main__":
    main()

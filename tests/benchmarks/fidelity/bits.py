"""Where the bits of a simulation come to differ: on processors that can do less, by graphics.

A few milliseconds are simulated once for each way of `WAYS`, in a process of its own, and so is
what follows from the first way's pictures; of every way, the first stage that differs from the
first way's is printed with how many of its values do, and so are the events.

Run: python tests/benchmarks bits [WAY ...] [--scene desk] [--rig davis346] [--renderer raster]
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_NO_512 = "X86_V4 AVX512_ICL AVX512_SPR"
WAYS: dict[str, dict[str, str]] = {
    "as it is": {},
    "kernels, 256 bits": {
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "+avx,+avx2,+fma,+bmi,+bmi2",
    },
    "kernels, nothing special": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "numpy, 256 bits": {"NPY_DISABLE_CPU_FEATURES": _NO_512},
    "numpy, 128 bits": {"NPY_DISABLE_CPU_FEATURES": f"{_NO_512} X86_V3"},
    "libm without FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"},
    "BLAS of AVX2": {"OPENBLAS_CORETYPE": "Haswell"},
    "BLAS of SSE": {"OPENBLAS_CORETYPE": "Nehalem"},
    "llvmpipe, 128 bits": {"LP_NATIVE_VECTOR_WIDTH": "128"},
    "llvmpipe, SSE": {"GALLIUM_OVERRIDE_CPU_CAPS": "sse4.1"},
}
Stage = tuple[str, NDArray[Any]]


def drawn(args: argparse.Namespace) -> tuple[Any, list[Any]]:
    """The render job, and all its frames."""
    from eventsweep import scenes
    from eventsweep.sim.config import SimConfig
    from eventsweep.sim.parallel.workers import frames_in_process
    from eventsweep.sim.rendering.drawing import drawing_of
    from eventsweep.sim.rigs import rig
    from eventsweep.sim.simulate import make_job

    config = SimConfig(duration_s=args.seconds, light={"renderer": args.renderer})
    made = scenes.load(args.scene), rig(args.rig), config, 0, drawing_of(config)
    job = make_job(*made)
    with job.renderer() as renderer:
        return job, list(frames_in_process(job, renderer, 0))


def stages(job: Any, frames: list[Any]) -> Iterator[Stage]:
    """Every array on the way from the motion to the events, in its order."""
    from eventsweep.sim.parallel.sensors import Cameras

    with ThreadPoolExecutor(len(job.rig)) as pool:
        cameras = Cameras(job, pool, None)
        for frame in frames:
            yield "time", np.array([frame.t_us])
            yield "pose", job.motion().T_world_body(frame.t_us * 1e-6)
            for k, samples in enumerate(frame.samples):
                yield f"samples' depth, camera {k}", samples.inverse_depth_per_m
                yield f"samples' light, camera {k}", samples.light
                yield f"pixels' light, camera {k}", frame.intensity[k]
            cameras.take(frame)
            for k, passage in enumerate(cameras.passages):
                yield from ((f"{name}, camera {k}", array) for name, array in carried(passage))
            for k, packet in enumerate(cameras.collect()):
                columns = np.stack([packet.events.t_us, packet.events.y, packet.events.x])
                yield f"events, camera {k}", columns
            yield from cameras.state().items()


def carried(passage: Any) -> Iterator[Stage]:
    """What a sensor takes of two frames, and the motion between them."""
    yield "boxes of samples", passage.after.light
    yield from ((f"reach.{name}", part) for name, part in passage.after.reach._asdict().items())
    yield "ways", passage.interval.ways
    yield "paths", passage._paths[1]
    layers = passage.layered.layers._asdict()
    yield from ((f"layers.{name}", part) for name, part in layers.items())


def simulated(args: argparse.Namespace) -> None:
    """In the process of one way: writes its frames and stages; those of given frames as well."""
    frames = args.out / "frames"
    job, own = drawn(args)
    for name in ("drawn", "given"):
        if name == "drawn" and not frames.exists():
            frames.write_bytes(pickle.dumps(own))
        with (args.out / f"{args.child}.{name}").open("wb") as file:
            for stage in stages(job, own if name == "drawn" else pickle.loads(frames.read_bytes())):
                pickle.dump(stage, file)


def read(path: Path) -> Iterator[Stage]:
    """What `simulated` wrote."""
    with path.open("rb") as file:
        while file.peek(1):
            yield pickle.load(file)


def difference(one: NDArray[Any], other: NDArray[Any]) -> str:
    """How many values differ and by how much at most; empty where none does."""
    if one.shape != other.shape:
        return f"shapes {one.shape} and {other.shape}"
    if one.tobytes() == other.tobytes():
        return ""
    apart = one != other
    if one.dtype.names:
        return f"{np.count_nonzero(apart)} of {apart.size} records"
    most = np.nanmax(np.abs(one[apart].astype(float) - other[apart].astype(float)), initial=0)
    return f"{np.count_nonzero(apart)} of {apart.size} values, by {most:.2g} at most"


def differences(first: Path, other: Path, *, everything: bool) -> Iterator[str]:
    """One line for the first stage that differs, and for each camera's first events that do."""
    shown: set[str] = set()
    for (stage, one), (name, another) in zip(read(first), read(other), strict=True):
        assert stage == name
        if (words := difference(one, another)) and stage not in shown:
            if everything or not shown or stage.startswith("events"):
                yield f"{stage}: {words}"
            shown.add(stage)


def main() -> None:
    """Runs all ways, and prints where they differ from the first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("ways", nargs="*", metavar="WAY", help=", ".join(WAYS))
    parser.add_argument("--scene", default="desk")
    parser.add_argument("--rig", default="davis346")
    parser.add_argument("--renderer", default="auto")
    parser.add_argument("--seconds", type=float, default=0.01)
    parser.add_argument("--all", action="store_true", help="every stage that differs")
    parser.add_argument("--out", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        simulated(args)
        return
    with tempfile.TemporaryDirectory() as folder:
        names = list(WAYS)[:1] + (args.ways or list(WAYS)[1:])
        for name in names:
            command = [sys.executable, *sys.orig_argv[1:], "--out", folder, "--child", name]
            subprocess.run(command, env=os.environ | WAYS[name], check=True)
            for part in ("drawn", "given"):
                first, other = (Path(folder, f"{which}.{part}") for which in (names[0], name))
                lines = list(differences(first, other, everything=args.all)) or ["the same bytes"]
                sys.stdout.write(f"{name}, pictures {part}: {'; '.join(lines)}\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()

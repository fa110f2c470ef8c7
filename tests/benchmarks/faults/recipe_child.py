"""What `recipe_runs` runs in a copy of the packages: one process for many commands."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import sys
from collections.abc import Iterable, Sequence
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from eventsweep.eval.cli.main import main

Line = Sequence[str]
RUNS: dict[str, tuple[str, str]] = {
    "every method": (
        "desk",
        "--method all --method Alg2/AtHc@4 --method Alg2/HcAt@2/time --method Alg2/GtRMSc@2~ "
        "--method Late/union --method Focus/A --method Focus/AtHc@4 --method Focus/cam1",
    ),
    "volumes on disk": (
        "desk",
        "--map.save-dsi --map.polarity separate --map.voting nearest --map.spacing linear "
        "--map.inpaint --map.no-interpolate --map.reference end --map.planes 40 "
        "--map.threshold-c 20 --method all --method Alg2/HtAc@2",
    ),
    "the authors' setting": (
        "desk", "--map.compatibility mcemvs --method all --method Alg2/HtAc@2"
    ),
    "windows of a count": (
        "desk",
        "--map.window-events 9000 --map.stride-events 6000 --map.reference-shift 0.5 "
        "--map.view-width-px 121 --map.view-focal-px 90 --map.hot-pixels 3 --map.threads 1 "
        "--map.extraction gradient --method Alg1/H --method Focus/G --method EMVS/cam1",
    ),
    "one fisheye": (
        "planes", "--map.window-s 0.1 --map.stride-s 0.05 --map.focus.measure dog"
    ),
    "three cameras": (
        "three", "--map.planes 50 --method all --method Alg2/HtHc@2 --method Late/union"
    ),
    "a lens that folds": ("folded", "--map.planes 30 --method Alg1/H --method EMVS/cam0"),
}  # fmt: skip
"""By name: a sequence, and flags of `map`. What changes no byte of all of them has no effect."""

SAME = "the same"


def held(lines: Iterable[tuple[Line, Line]]) -> None:
    """Runs pairs of commands, those before a gate and the gate; ends the process at the first red.

    Prints what the gate names first.
    """
    for commands, gate in lines:
        for command in commands:
            ended(main([*command, "--quiet"]))
        said = io.StringIO()
        with redirect_stdout(said):
            code = main([*gate, "--json"])
        reds = [one for one in json.loads(said.getvalue() or "[]") if one["is_red"]]
        if code:
            words = (reds[0][part] for part in ("case", "method", "metric", "status"))
            sys.stdout.write(" ".join(words) if reds else f"exit code {code}")
        ended(code)


def differs(place: Path, known: dict[str, str] | None) -> None:
    """Runs everything of `RUNS` on sequences in a folder, and prints hashes of what was written.

    With those of another state of the code it prints the name of the first run that differs, or
    `SAME`.
    """
    found: dict[str, str] = {}
    for name in ("simulated", *RUNS):
        out = place / "broad"
        shutil.rmtree(out, ignore_errors=True)
        if name == "simulated":
            scene = ("planes", "--rig", "oblique", "--seconds", "0.05", "--seed", "0")
            code = main(["simulate", *scene, "--out", str(out), "--quiet"])
        else:
            sequence, flags = RUNS[name]
            mapped = ["map", str(place / sequence), "--out", str(out), "--no-check", "--quiet"]
            code = main([*mapped, *flags.split()]) or main(["score", str(out), "--quiet"])
        found[name] = f"{code} {digest(out)}"
        if known is not None and known[name] != found[name]:
            sys.stdout.write(f"\n{name}")
            return
    sys.stdout.write("\n" + (json.dumps(found) if known is None else SAME))


def digest(folder: Path) -> str:
    """Hash of the arrays, volumes, clouds, events and scores in a folder, of no times of clocks."""
    said = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".npz":
            with np.load(path) as arrays:
                for name in sorted(arrays):
                    said.update(name.encode() + arrays[name].tobytes())
        elif path.suffix in (".npy", ".ply", ".csv", ".txt"):
            said.update(path.read_bytes())
        elif path.suffix == ".h5":
            said.update(_content(path))
    return said.hexdigest()


def _content(path: Path) -> bytes:
    import h5py

    parts: list[bytes] = []

    def visit(name: str, node: h5py.Dataset | h5py.Group) -> None:
        if isinstance(node, h5py.Dataset):
            parts.append(name.encode() + np.asarray(node[()]).tobytes())

    with h5py.File(path) as file:
        file.visititems(visit)
    return b"".join(parts)


def ended(code: int) -> None:
    """Ends the process unless a command ended well."""
    if code:
        sys.stdout.flush()
        sys.exit(code)

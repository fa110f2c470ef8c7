"""Scores fused maps as geometries: `python tests/benchmarks geometry_scores --out FOLDER`.

Each sequence is simulated, mapped in sliding windows and fused by the commands that users have, and
its clouds and meshes are scored into `FOLDER/geometry/SCENE/seedN`, from where `eventsweep ranking`
takes them. What is done is not done again; after a change of the program take another folder. With
`--page` the table is written into a page.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterable, Iterator
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.cli.main import main as eventsweep
from eventsweep.eval.results.results import Results, read_results
from markdown_blocks import show
from table_code import Code, of_methods, of_scenes

MARK = "geometry-scores"
SECONDS, WINDOW_S, STRIDE_S = 0.3, 0.1, 0.05
VOXEL_M, PART = 0.02, 20
FUSED = ("Alg1/H", "Focus/H")
SHOWN = {
    "accuracy": ("accuracy, cm", 100), "completion": ("completion, cm", 100),
    "surface_precision_5cm": ("precision 5 cm, %", 1),
    "surface_recall_5cm": ("recall 5 cm, %", 1), "surface_f1_5cm": ("F1 5 cm, %", 1),
}  # fmt: skip
"""Metric -> heading, and what its values are multiplied with."""


class Sequence(NamedTuple):
    """A scene with a seed."""

    scene: str
    seed: int

    @property
    def place(self) -> str:
        """Its folder below another."""
        return f"{self.scene}/seed{self.seed}"


SEQUENCES = (Sequence("desk", 0), Sequence("desk", 1), Sequence("boxes", 0), Sequence("boxes", 1))


def scored(sequence: Sequence, folder: Path) -> Results:
    """Scores of the four geometries of a sequence; made unless the folder holds them.

    Raises:
        InputError: a command failed.
    """
    out = folder / "geometry" / sequence.place
    if not out.exists():
        at = mapped(sequence, folder)
        named = [word for method in FUSED for word in _fused(method, at)]
        truth = ("--truth", at / "sequence", "--case", sequence.scene)
        verb("score", *named, *truth, "--out", out)
    return read_results(out)


def mapped(sequence: Sequence, folder: Path) -> Path:
    """The folder of a sequence and its map, beside the scores of the run."""
    out = folder / "run" / sequence.place
    if not (out / "results.json").exists():
        methods = (word for method in (*FUSED, "SGM/window") for word in ("--method", method))
        verb(
            "run", sequence.scene, "--seed", sequence.seed, "--seconds", SECONDS,
            "--map.window-s", WINDOW_S, "--map.stride-s", STRIDE_S, *methods, "--out", out,
        )  # fmt: skip
    return out / sequence.scene


def _fused(method: str, at: Path) -> Iterator[str]:
    """`NAME=FILE` of a method's cloud and mesh."""
    verb(
        "fuse", at / "map", "--method", method, "--voxel-m", VOXEL_M,
        "--mesh", "--mesh-part", PART,
    )  # fmt: skip
    name = method.replace("/", "-")
    for kind in ("cloud", "mesh"):
        yield f"{name}-{kind}={at}/map/global/{name}/{kind}.ply"


def verb(*words: object, ends: Collection[int] = (0,)) -> None:
    """Runs a command of the program.

    Raises:
        InputError: it ended with another exit code than those of `ends`.
    """
    said = StringIO()
    with redirect_stderr(said):
        code = eventsweep([*map(str, words), "--quiet"])
    if code not in ends:
        raise InputError(f"exit code {code} of {' '.join(map(str, words))}: {said.getvalue()}")


def table(found: Iterable[Results]) -> str:
    """A line per geometry in Markdown, means over scenes and seeds."""
    results = list(found)
    several = ", ".join(f"`{one.scene}` {one.seed}" for one in SEQUENCES)
    lines = [
        f"Written by `python tests/benchmarks geometry_scores`: means over {several} (scene and "
        f"seed), {SECONDS:g} s each, mapped in windows of {WINDOW_S:g} s, {STRIDE_S:g} s apart, "
        f"fused with `--voxel-m {VOXEL_M:g} --mesh --mesh-part {PART}`.",
        "",
        f"| | {' | '.join(title for title, _ in SHOWN.values())} |",
        "|---|" + "--:|" * len(SHOWN),
    ]
    for name in dict.fromkeys(results[0].rows["method"]):
        cells = (
            f"{factor * sum(_values(results, name, metric)) / len(results):.2f}"
            for metric, (_, factor) in SHOWN.items()
        )
        lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _values(results: Iterable[Results], method: str, metric: str) -> list[float]:
    chosen = (
        one.rows[(one.rows["method"] == method) & (one.rows["metric"] == metric)] for one in results
    )
    return [float(rows["value"].item()) for rows in chosen]


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    functions = ("geometry_scores:table", "geometry_scores:FUSED")
    verbs = (
        "eventsweep.eval.stages.simulate", "eventsweep.eval.stages.map",
        "eventsweep.emvs.maps.merge", "eventsweep.plugins.geometry.score",
        "eventsweep.plugins.geometry.truth", "eventsweep.plugins.geometry.readers",
    )  # fmt: skip
    its = Code(functions, verbs) + of_methods(FUSED) + of_scenes({s.scene for s in SEQUENCES})
    return {f"plugins/geometry/geometry.md#{MARK}": its}


def main() -> int:
    """See the module."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of sequences and scores")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    asked = parser.parse_args()
    with exit_code() as ended:
        show(table(scored(one, asked.out) for one in SEQUENCES), asked.page, MARK, code)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())

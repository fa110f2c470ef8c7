"""Our baselines of the ranking's tracks: `python tests/benchmarks ranking_tracks --out FOLDER`.

Runs the commands that users have, on the sequences of `geometry_scores`, whose folder may be the
same: its maps and their geometries, maps filled by planes, and tracked poses. It leaves scores as
`FOLDER/TRACK/SCENE/seedN`, which `eventsweep ranking` takes beside the results of a suite. What is
done is not done again.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

from eventsweep.eval.cli.exit_codes import exit_code
from geometry_scores import SEQUENCES, Sequence, mapped, scored, verb
from plane_filling import fill_map

TRACKS = ("dense", "geometry", "odometry")
_FILLED, _SEEN = "Focus/H", (0, 1)  # what planes are put through; exit codes of `track`


def dense(sequence: Sequence, folder: Path) -> None:
    """Scores of the depth maps, and of the planes between their points."""
    out = folder / "dense" / sequence.place
    if out.exists():
        return
    run, planes = mapped(sequence, folder).parent, folder / "planes" / sequence.place
    fill_map(run / sequence.scene / "map", _FILLED, planes)
    verb("score", run, "--prediction", f"Planes={planes}")
    out.mkdir(parents=True)
    shutil.copy(run / "results.json", out)


def odometry(sequence: Sequence, folder: Path) -> None:
    """Scores of the poses that are found from events alone."""
    out, found = (folder / name / sequence.place for name in ("odometry", "track"))
    if out.exists():
        return
    at = mapped(sequence, folder) / "sequence"
    verb("track", at, "--out", found, "--force", ends=_SEEN)
    poses = f"track={found / 'trajectory.txt'}"
    verb("score", poses, "--truth", at, "--case", sequence.scene, "--out", out)


def main() -> int:
    """See the module."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of sequences and scores")
    parser.add_argument("--only", choices=TRACKS, action="append", help="only this track")
    asked = parser.parse_args()
    of = {"dense": dense, "geometry": scored, "odometry": odometry}
    with exit_code() as ended:
        for sequence in SEQUENCES:
            for name in asked.only or TRACKS:
                of[name](sequence, asked.out)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())

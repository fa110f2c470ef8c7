"""Do fitted sensors have the parameters that they were simulated with? Writes a table to the docs.

Sensors are drawn by a seed, recorded with frames beside on three scenes that move and on one at
rest, and fitted. Numbers were chosen on seeds below 200; those from 300 on are for one run at the
end, in several processes if need be, whose rows make one table.

    python tests/benchmarks sensor_fit --first 300 --count 12 --rows rows.json
    python tests/benchmarks sensor_fit --of rows.json --table
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from eventsweep import scenes
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.diagnose.sensing.fit import SensorFit, fit_sensor
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate
from markdown_blocks import show

SCENES = "boxes", "desk", "planes", "rest"
REST_S = 3.0
"""How long the camera rests before `planes`, s: there noise stands alone."""
RIG = Rig("probe", (Camera(160, 120, 130, 130, 79.5, 59.5),), (np.eye(4),))
LIMITS = {
    "contrast_threshold_pos": 0.05, "contrast_threshold_neg": 0.05, "refractory_period_us": 0.1,
    "bandwidth_hz": 0.3, "shot_rate_hz": 0.2,
}  # fmt: skip
"""How far from the truth an estimate may be, as a share of it."""
PAGE = Path("docs/sensor.md")


def drawn(seed: int) -> dict[str, Any]:
    """Parameters of a sensor, uniform in their logarithms."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")

    c_pos, dark = between(0.12, 0.35), between(0.5, 4)
    return {
        "contrast_threshold_pos": c_pos,
        "contrast_threshold_neg": float(f"{c_pos * between(0.75, 1.4):.4g}"),
        "refractory_period_us": round(between(300, 1500)),
        "sensor": {
            "threshold_sigma": float(f"{c_pos * between(0.05, 0.2):.4g}"),
            "bandwidth_hz": between(80, 400),
            "shot_rate_dark_hz": dark,
            "shot_rate_bright_hz": float(f"{dark * between(0.25, 1):.4g}"),
            "leak_rate_hz": between(0.05, 0.5), "noise_spread_decades": between(0.05, 0.25),
            "hot_pixel_fraction": 5e-4, "hot_pixel_rate_hz": 200.0,
            "latency_us": 15.0, "latency_jitter": 0.3, "readout_events_per_s": 12e6,
        },
    }  # fmt: skip


def at_rest(folder: Path) -> dict[str, Any]:
    """Settings of a simulation whose camera does not move."""
    poses = folder / "rest.txt"
    stamps = np.arange(0, REST_S + 0.5, 0.01)
    poses.write_text("".join(f"{t:.6f} 0 0 0 0 0 0 1\n" for t in stamps))
    return {"duration_s": REST_S, "replay": {"trajectory": poses}}


def recorded(seed: int, folder: Path) -> tuple[SensorFit, dict[str, float], str]:
    """The fit of a drawn sensor on its scene, and the truth by the estimates' names."""
    values, scene = drawn(seed), SCENES[seed % len(SCENES)]
    frames = {"rate_hz": 200.0, "exposure_us": 1000, "gain": 1.0}
    lasting = at_rest(folder) if scene == "rest" else {"duration_s": 1.0}
    settings = {"sampling": "fast", "truth_interval_s": 1.0, "frames": frames, **lasting}
    config = SimConfig(**settings, **values)
    place = scenes.load("planes" if scene == "rest" else scene)
    path = simulate(place, RIG, config, seed, folder / f"{seed}", force=True)
    fit = fit_sensor(Sequence.open(path))
    truth = {**values, **values["sensor"]}
    dark, bright = truth["shot_rate_dark_hz"], truth["shot_rate_bright_hz"]
    rate_hz = dark + (bright - dark) * min(fit.noise_light, 1.0)
    return fit, {**truth, "shot_rate_hz": rate_hz}, scene


def rows_of(seed: int, folder: Path) -> list[dict[str, Any]]:
    """One row per parameter: truth, estimate, uncertainty."""
    fit, truth, scene = recorded(seed, folder)
    return [
        {"seed": seed, "scene": scene, "truth": truth[estimate.name], **estimate.facts()}
        for estimate in fit.estimates if estimate.name in truth
    ]  # fmt: skip


def table_of(rows: list[dict[str, Any]]) -> str:
    """Markdown: per parameter how many were fitted, how far off, and how often the band holds."""
    lines = [
        "| parameter | fitted | refused | median error | largest | within the limit | "
        "truth in the 95 % band |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    total = held = 0
    for name in dict.fromkeys(row["name"] for row in rows):
        mine = [row for row in rows if row["name"] == name]
        known = [row for row in mine if row["value"] is not None]
        off = np.array([row["value"] / row["truth"] - 1 for row in known])
        inside = sum(abs(r["value"] - r["truth"]) <= r["uncertainty"] for r in known)
        total, held = total + len(known), held + inside
        within = "–"
        if name in LIMITS:
            good = np.count_nonzero(np.abs(off) <= LIMITS[name])
            within = f"{good}/{len(known)} ({LIMITS[name]:.0%})"
        errors = (
            (f"{np.median(np.abs(off)):.1%}", f"{np.abs(off).max():.1%}")
            if len(off)
            else ("–", "–")
        )
        cells = f"`{name}`", len(known), len(mine) - len(known), *errors, within
        lines.append(f"| {' | '.join(map(str, cells))} | {inside}/{len(known)} |")
    share = f"{held}/{total} ({held / max(total, 1):.0%})"
    lines.append(f"| all | {total} | {len(rows) - total} | | | | {share} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Draws, records, fits; prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=3)
    parser.add_argument("--rows", type=Path, help="file for all rows, JSON")
    parser.add_argument("--of", type=Path, nargs="+", help="files of rows to make the table of")
    parser.add_argument("--table", action="store_true", help=f"write the table into {PAGE}")
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for path in given.of or ():
        rows += json.loads(path.read_text())
    if given.of:
        show(table_of(rows), PAGE if given.table else None, "sensor-fit")
        return
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first, given.first + given.count):
            rows += rows_of(seed, Path(folder))
            if given.rows:
                given.rows.write_text(json.dumps(rows, indent=1))
    show(table_of(rows), PAGE if given.table else None, "sensor-fit")


if __name__ == "__main__":
    main()

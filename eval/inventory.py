"""What there is to choose from: cases, rigs, methods, metrics."""

from __future__ import annotations

import scenes
from emvs import methods
from eval.score import ALL_METRICS
from eval.studies.study import STUDIES
from sim.rigs import RIGS


def inventory() -> dict[str, dict[str, str]]:
    """Names and one line on each, by kind."""
    return {
        "cases": dict(scenes.summaries()),
        "rigs": {name: _rig_line(name) for name in RIGS},
        "methods": methods.overview(),
        "studies": {
            study.name: f"{study.axis}, {study.amounts[0]:g} to {study.amounts[-1]:g} {study.unit}"
            for study in STUDIES.values()
        },
        "metrics": {
            name: f"{metric.formula} [{metric.unit}], better: {metric.better}"
            for name, metric in ALL_METRICS.items()
        },
    }


def _rig_line(name: str) -> str:
    rig = RIGS[name]
    first = rig.cameras[0]
    baseline = f", baseline {100 * rig.baseline_m():.2f} cm" if len(rig) > 1 else ""
    return f"{len(rig)} x {first.width_px}x{first.height_px}, f = {first.fx_px:g} px{baseline}"

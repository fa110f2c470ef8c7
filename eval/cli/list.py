"""`eventsweep list`: what there is to choose from: cases, rigs, methods, metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eval.cli.app import COMMON, Common, app

if TYPE_CHECKING:
    from emvs.geometry.rig import Rig


@app.command(name="list")
def list_everything(*, common: Common = COMMON) -> None:
    """List cases, rigs, methods and metrics."""
    common.console().inventory(inventory())


def inventory() -> dict[str, dict[str, str]]:
    """Names and one line on each, by kind: cases, rigs, methods, studies, metrics."""
    import scenes
    from emvs import methods
    from eval.scoring.method_scores import ALL_METRICS
    from eval.studies.definitions import STUDIES
    from sim.rigs import RIGS

    return {
        "cases": dict(scenes.summaries()),
        "rigs": {name: _rig_line(rig) for name, rig in RIGS.items()},
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


def _rig_line(rig: Rig) -> str:
    first = rig.cameras[0]
    baseline = f", baseline {100 * rig.baseline_m():.2f} cm" if len(rig) > 1 else ""
    return f"{len(rig)} x {first.width_px}x{first.height_px}, f = {first.fx_px:g} px{baseline}"

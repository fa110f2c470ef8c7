"""What users choose by name: one list of it all, and what a shell completes.

Each kind's names and descriptions come from the registry that knows them; nothing is listed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eventsweep.emvs.geometry.rig import Rig


def scenes(_: Any = None) -> Mapping[str, str]:
    """Scenes."""
    from eventsweep.scenes import summaries

    return summaries()


def rigs(_: Any = None) -> Mapping[str, str]:
    """Rigs."""
    from eventsweep.sim.rigs import RIGS

    return {name: _rig_line(rig) for name, rig in RIGS.items()}


def sensors(_: Any = None) -> Mapping[str, str]:
    """Sensor presets."""
    from eventsweep.sim.sensor_presets import PRESETS

    return {name: preset.summary for name, preset in PRESETS.items()}


def head_styles(_: Any = None) -> Mapping[str, str]:
    """Ways of moving the head."""
    from eventsweep.sim.motion.head_styles import STYLES

    return {name: style.summary for name, style in STYLES.items()}


def methods(_: Any = None) -> Mapping[str, str]:
    """Methods of mapping, and grammars of their families."""
    from eventsweep.emvs.methods import overview

    return overview()


def method_names(_: Any = None) -> Mapping[str, str]:
    """Methods that a shell can complete: of families, whose names are made by a grammar, some."""
    from eventsweep.emvs.methods import families, overview

    whole = {name: text for name, text in overview().items() if " " not in name}
    examples = {name: family.summary for family in families().values() for name in family.examples}
    return whole | examples


def metrics(_: Any = None) -> Mapping[str, str]:
    """Metrics."""
    from eventsweep.eval.scoring.trajectories.metrics import KNOWN_METRICS

    direction = {"none": "neither end is better"}
    return {
        name: f"{metric.title} [{metric.unit or '1'}]: {metric.formula}; "
        f"{direction.get(metric.direction, f'{metric.direction} is better')}"
        for name, metric in KNOWN_METRICS.items()
    }


def studies(_: Any = None) -> Mapping[str, str]:
    """Studies."""
    from eventsweep.eval.studies.definitions import STUDIES

    return {
        study.name: f"{study.axis}, {study.amounts[0]:g} to {study.amounts[-1]:g} {study.unit}"
        for study in STUDIES.values()
    }


def suites(_: Any = None) -> Mapping[str, str]:
    """Suites and their subsets."""
    from eventsweep.eval.suite.definition import overview

    return overview()


def formats(_: Any = None) -> Mapping[str, str]:
    """Event formats."""
    from eventsweep.emvs.formats import FORMATS

    return {
        name: f"{event_format.what}, {'read and written' if event_format.writes else 'read only'}"
        for name, event_format in FORMATS.items()
    }


KINDS: dict[str, Callable[[], Mapping[str, str]]] = {
    "scenes": scenes, "rigs": rigs, "sensors": sensors, "head-styles": head_styles,
    "methods": methods, "metrics": metrics, "studies": studies, "suites": suites,
    "formats": formats,
}  # fmt: skip


def _rig_line(rig: Rig) -> str:
    first = rig.cameras[0]
    size = f"{first.width_px}x{first.height_px} px, focal length {first.fx_px:.1f} px"
    baseline = f", baseline {100 * rig.baseline_m():.2f} cm" if len(rig) > 1 else ""
    return f"{len(rig)} cameras of {size}{baseline}"

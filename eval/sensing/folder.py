"""What `fit` and `realism` write: files for programs, and the page."""

from __future__ import annotations

import json
from pathlib import Path

import tomli_w

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.eval.report.html import REPORT_NAME
from eventsweep.eval.sensing.fit import SensorFit
from eventsweep.eval.sensing.pages import fit_page, realism_page
from eventsweep.eval.sensing.realism import Realism

SENSOR_NAME, FIT_NAME, REALISM_NAME = "sensor.toml", "fit.json", "realism.json"


def write_fit(folder: Path, fit: SensorFit, name: str, command: str = "") -> None:
    """Writes sensor.toml, fit.json and report.html."""
    lines = [
        f"# The sensor of {name!r}, fitted by eventsweep; --sim.sensor.preset takes this file."
    ]
    lines += [f"# {e.name}: refused, {e.refused}" for e in fit.estimates if e.refused]
    if fit.effective:
        lines.append("# The thresholds make as many events as recorded when the frames drive the")
        lines.append("# simulator; they are not measured.")
    text = "\n".join(line.replace("\r", " ") for line in lines)
    (folder / SENSOR_NAME).write_text(f"{text}\n{tomli_w.dumps(fit.values())}", encoding="utf-8")
    facts = {
        "estimates": [estimate.facts() for estimate in fit.estimates],
        "effective_thresholds": list(fit.effective), "on_share": fit.on_share,
        "noise_light": fit.noise_light if fit.frames is not None else None,
        "events": len(fit.pixels), "seconds": fit.pixels.seconds,
    }  # fmt: skip
    (folder / FIT_NAME).write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    page = fit_page(fit, name, command, (SENSOR_NAME, FIT_NAME))
    (folder / REPORT_NAME).write_text(page, encoding="utf-8")


def write_realism(folder: Path, realism: Realism, command: str = "") -> None:
    """Writes realism.json and report.html."""
    text = json.dumps(realism.facts(), indent=1) + "\n"
    (folder / REALISM_NAME).write_text(text, encoding="utf-8")
    page = realism_page(realism, command, (REALISM_NAME,))
    (folder / REPORT_NAME).write_text(page, encoding="utf-8")


def part_of(
    recording: Recording, camera: int, start_s: float | None, duration_s: float | None
) -> tuple[int, int]:
    """First and last instant of a part of a recording, µs.

    Raises:
        InputError: no such camera, or a part outside of the recording.
    """
    recording.rig.check_camera(camera)
    return part_of_span(recording.name, recording.event_span_us(camera), start_s, duration_s)


def part_of_span(
    name: str, span_us: tuple[int, int], start_s: float | None, duration_s: float | None
) -> tuple[int, int]:
    """The same of a span, µs, of something with a name."""
    first_us, last_us = span_us
    begin_us = first_us + round((start_s or 0.0) * 1e6)
    end_us = last_us if duration_s is None else min(last_us, begin_us + round(duration_s * 1e6))
    if not first_us <= begin_us < end_us:
        length = "" if duration_s is None else f" for {duration_s:g} s"
        raise InputError(
            f"{name}: from {start_s or 0:g} s{length} of a recording of "
            f"{(last_us - first_us) * 1e-6:g} s: choose a part within it"
        )
    return begin_us, end_us

"""Prints what `eventsweep info` found."""

from __future__ import annotations

import json
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from eval.info import warnings

_ROWS = {
    "events": "events",
    "brighter": "brighter",
    "darker": "darker",
    "first_us": "first, s",
    "last_us": "last, s",
    "duration_s": "duration, s",
    "mean_rate_hz": "mean rate, kev/s",
    "peak_rate_hz": "peak rate, kev/s",
    "sensor_px": "sensor, px",
    "largest_px": "largest pixel",
    "outside_sensor": "off the sensor",
    "out_of_order": "out of order",
    "gaps": "silences over 0.1 s",
}


def show(description: dict[str, Any], *, as_json: bool) -> None:
    """Writes the facts to standard output, as tables or as JSON."""
    console = Console(highlight=False)
    if as_json:
        console.out(json.dumps(description, indent=2, ensure_ascii=False), highlight=False)
        return
    console.print(
        f"[bold]{escape(description['path'])}[/]: {escape(description['what'])}", soft_wrap=True
    )
    console.print(_streams(description))
    if description["recording"] is not None:
        console.print(_recording(description["recording"]))
    for sentence in warnings(description):
        console.print(f"note: {sentence}", style="yellow", markup=False, soft_wrap=True)


def _streams(description: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for stream in description["streams"]:
        table.add_column(escape(stream["name"]), justify="right")
    for key, title in _ROWS.items():
        table.add_row(title, *(_cell(key, stream[key]) for stream in description["streams"]))
    return table


def _cell(key: str, value: Any) -> str:
    if value is None:
        return "–"
    if key.endswith("_us"):
        return f"{value * 1e-6:.6f}"
    if key.endswith("_hz"):
        return f"{value * 1e-3:,.1f}"
    if key.endswith("_px"):
        return f"{value[0]}x{value[1]}" if key == "sensor_px" else f"{value[0]}, {value[1]}"
    return f"{value:,}" if isinstance(value, int) else f"{value:.6f}"


def _recording(facts: dict[str, Any]) -> Table:
    table = Table(box=None, pad_edge=False, show_header=False)
    for camera in facts["cameras"]:
        size = f"{camera['width_px']}x{camera['height_px']} px, {camera['model']}"
        table.add_row(escape(camera["name"]), f"{size}, f {camera['fx_px']:.1f} px")
    if facts["baseline_m"] is not None:
        table.add_row("baseline", f"{facts['baseline_m'] * 100:.2f} cm")
    first, last = (t * 1e-6 for t in facts["poses_us"])
    rate = "" if facts["pose_rate_hz"] is None else f", {facts['pose_rate_hz']:.1f} Hz"
    table.add_row("poses", f"{facts['poses']:,} from {first:.6f} to {last:.6f} s{rate}")
    table.add_row("poses cover events", "yes" if facts["poses_cover_events"] else "no")
    table.add_row("ground truth", f"at {facts['truth_times']:,} times")
    if facts["renderer"] is not None:
        table.add_row("drawn by", escape(facts["renderer"]))
    return table

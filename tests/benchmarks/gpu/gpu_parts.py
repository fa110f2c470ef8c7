"""The parts of `tests/benchmarks/gpu/bench_gpu.py`: what is measured, as plain values for JSON."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any

from cost_stream import MovingEdges
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.window_result import WindowResult
from gpu_calls import agreement, call, save_volumes
from gpu_plan import LIMIT_MS, PRECISIONS, BenchmarkPlan
from gpu_series import grow, stream
from gpu_votes import votes_s

Part = dict[str, Any]


class Bench:
    """One run: its parts share the events and the results of the whole calls."""

    def __init__(self, plan: BenchmarkPlan, device: str) -> None:
        self.plan, self.device = plan, device
        self.wrong: list[str] = []
        self._results: dict[str, WindowResult] = {}

    @cached_property
    def recording(self) -> MovingEdges:
        """The events of the whole call, made once."""
        made = MovingEdges(self.plan.size_px, self.plan.events)
        made.event_span_us(0)
        return made

    def parts(self) -> dict[str, Callable[[], Part]]:
        """Every part by its name, the most wanted first."""
        return {
            "atomics": self.atomics, "whole": self.whole, "agreement": self.agreement,
            "sliding": self.sliding, "frames": self.frames, "growth": self.growth,
        }  # fmt: skip

    def atomics(self) -> Part:
        """Atomic additions per second."""
        if self.device != "cuda":
            raise InputError("no GPU was asked for")
        from eventsweep.plugins.cuda import device as library
        from gpu_atomics import atomic_rates

        rates = atomic_rates(self.plan, library.gpu().l2_bytes)
        self.wrong += [f"atomics: {r.kind} on {r.grid} lost some" for r in rates if not r.right]
        return {"rates": [asdict(rate) for rate in rates]}

    def whole(self) -> Part:
        """Algorithm 1 with all functions, by both ways of summing, and on the CPU."""
        plan, calls = self.plan, {}
        for precision in PRECISIONS:
            config = plan.config(self.device, precision)
            calls[precision] = self._call(precision, config, plan.rounds)
        calls["cpu"] = self._call("cpu", plan.config("cpu"), plan.cpu_rounds)
        if not calls["fixed"]["repeats"]:
            self.wrong.append("whole: fixed votes gave other bits in another call")
        load = {"events": 2 * plan.events, "planes": plan.planes, "size_px": plan.size_px}
        return {"load": load, "limit_ms": LIMIT_MS, "calls": calls}

    def _call(self, name: str, config: MapperConfig, rounds: int) -> Part:
        found, self._results[name] = call(self.recording, config, rounds)
        alone_s = votes_s(self.recording, config, rounds)
        return asdict(found) | {"median_s": found.median_s, "votes_s": alone_s}

    def agreement(self) -> Part:
        """Volumes and maxima of the GPU against those of the CPU."""
        plan, found = self.plan, {}
        if "cpu" not in self._results:
            raise InputError("needs the part `whole`")
        with tempfile.TemporaryDirectory() as folder:
            theirs = save_volumes(self.recording, plan.config("cpu"), Path(folder) / "cpu")
            for precision in PRECISIONS:
                config = plan.config(self.device, precision)
                ours = save_volumes(self.recording, config, Path(folder) / precision)
                results = self._results[precision], self._results["cpu"]
                found[precision] = agreement(*results, ours, theirs)
                self.wrong += found[precision].faults(f"agreement, {precision}")
        return {name: asdict(one) for name, one in found.items()}

    def sliding(self) -> Part:
        """A long sequence, window by window."""
        plan = self.plan
        return {
            "gpu": asdict(stream(plan, self.device, plan.windows)),
            "cpu": asdict(stream(plan, "cpu", plan.cpu_windows)),
            "size_px": plan.size_px, "planes": plan.planes, "window_events": plan.window_events,
        }  # fmt: skip

    def frames(self) -> Part:
        """Pictures per second."""
        from gpu_frames import frames

        drawn = frames(self.plan)
        self.wrong += [fault for one in drawn for fault in one.faults()]
        return {"drawn": [asdict(one) for one in drawn]}

    def growth(self) -> Part:
        """Time over events, planes and pixels."""
        grown = grow(self.recording, self.plan, self.device)
        exponents = [{"exponent": g.exponent, "last_exponent": g.last_exponent} for g in grown]
        return {"series": [asdict(g) | e for g, e in zip(grown, exponents, strict=True)]}

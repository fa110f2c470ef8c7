"""A small report with known numbers, which several tests open."""

from html.parser import HTMLParser

import numpy as np

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.eval.figures.plots import DsiSlice
from eventsweep.eval.report.run_data import CaseData, MethodData, RunData, WindowData
from eventsweep.eval.results.results import Results
from eventsweep.eval.results.table import together
from eventsweep.eval.scoring.pairing import Truth, pair_methods
from eventsweep.eval.scoring.score import case_rows

SHAPE = (24, 32)
# Relative error and share of pixels per method: what the report must find out by itself.
METHODS = {
    "Alg1/max": (0.30, 0.9), "Alg1/H": (0.02, 0.4), "Alg1/A": (0.05, 0.6), "EMVS/cam0": (0.10, 0.7),
}  # fmt: skip


def window_data(name, seed, truth=True):
    rng = np.random.default_rng(seed)
    truth_m = rng.uniform(0.6, 3.0, SHAPE)
    rho = np.linspace(2.0, 0.25, 12)
    methods = []
    for method, (error, share) in METHODS.items():
        depth_m = truth_m * (1 + error)
        mask = rng.random(SHAPE) < share
        row = truth_m[12] if truth else None
        dsi_slice = DsiSlice(12, rho, rng.random((12, 32)), depth_m[12], mask[12], row)
        methods.append(MethodData(method, depth_m, mask, rng.random(SHAPE) * 30, dsi_slice))
    return WindowData(
        name=name, t_us=250_000, methods=tuple(methods), depth_range_m=(0.5, 4.0),
        frame=rng.integers(0, 256, SHAPE).astype(np.uint8) if truth else None,
        brighter=rng.integers(0, 4, SHAPE), darker=rng.integers(0, 4, SHAPE),
        camera=Camera(32, 24, 30.0, 30.0, 15.5, 11.5),
        truth=Truth(truth_m, np.ones(SHAPE, bool), 30.0, 0.1) if truth else None,
        counts={"left": {"events": 1234567, "without pose": 3}},
    )  # fmt: skip


def rows_of(case, windows):
    pairs = {
        w.name: pair_methods({m.name: (m.depth_m, m.mask) for m in w.methods}, w.truth)
        for w in windows
    }
    return case_rows(case, pairs)


def report_data(*names, windows=1, truth=True):
    cases, rows = [], []
    for position, name in enumerate(names):
        views = tuple(window_data(f"w{k:03d}", 10 * position + k, truth) for k in range(windows))
        cases.append(CaseData(name, "a test <scene>", views, windows + 2, (("rig", "two eyes"),)))
        rows += [rows_of(name, views)] if truth else []
    results = Results.from_dataframe(
        together(rows), seed=7, sequences=dict.fromkeys(names, "ab" * 32)
    )
    return RunData(tuple(cases), results, "mean_error", "planes = 12\n")


class WellFormed(HTMLParser):
    """Checks that tags nest, and collects what a test asks about."""

    VOID = frozenset({"meta", "img", "input", "br"})

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.sources, self.checked = [], [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.ids += [values["id"]] if "id" in values else []
        self.sources += [values[key] for key in ("src", "href", "xlink:href") if key in values]
        self.checked += [values["id"]] if "checked" in values and "id" in values else []
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

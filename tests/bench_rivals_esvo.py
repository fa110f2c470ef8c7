"""What ESVO and GTS cost: `pytest tests/bench_rivals_esvo.py --benchmark-only`."""

import pytest
from point_world import fronto_parallel

from emvs.config import MapperConfig
from emvs.rivals import esvo, gts
from emvs.view import reference_view
from emvs.window import choose_window

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25, border_px=0)


@pytest.mark.parametrize("points", [600, 3000])
@pytest.mark.parametrize("function", [esvo.estimate, esvo.estimate_window, gts.estimate])
def test_a_window(benchmark, function, points):
    recording = fronto_parallel(1.3, points=points)
    window = choose_window(recording, CONFIG)
    view = reference_view(recording, CONFIG, window.t_ref_us)
    benchmark(function, recording, window, view, CONFIG)
    benchmark.extra_info["events"] = sum(len(s) for s in recording.streams)

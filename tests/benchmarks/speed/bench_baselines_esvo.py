"""What ESVO and GTS cost.

`pytest tests/benchmarks/speed/bench_baselines_esvo.py --benchmark-only`
"""

import sys
import time

import pytest

from eventsweep.emvs.baselines import esvo, gts
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.reference_view import reference_view
from eventsweep.emvs.windows import choose_window
from point_world import fronto_parallel

CONFIG = MapperConfig(min_depth_m=0.5, max_depth_m=4.0, planes=25, border_px=0)


@pytest.mark.parametrize("points", [2000, 6000])
@pytest.mark.parametrize("function", [esvo.estimate, esvo.estimate_window, gts.estimate])
def test_a_window(benchmark, function, points, capsys):
    recording = fronto_parallel(1.3, points=points)
    window = choose_window(recording, CONFIG)
    view = reference_view(recording, CONFIG, window.t_ref_us)
    events = sum(len(s) for s in recording.streams)
    benchmark.pedantic(function, (recording, window, view, CONFIG), rounds=3, warmup_rounds=1)
    begin = time.process_time()
    function(recording, window, view, CONFIG)
    taken_ns = 1e9 * (time.process_time() - begin)
    with capsys.disabled():
        name = f"{function.__module__}.{function.__name__}"
        sys.stdout.write(f"\n  {name}: {events} events, {taken_ns / events:.0f} ns each")

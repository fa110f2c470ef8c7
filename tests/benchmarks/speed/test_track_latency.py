"""Latencies count from the end of a packet, at the pace of the recording, after the beginning."""

import time
from types import SimpleNamespace

import pytest

import track_latency
from track_latency import fed

BEGINS, SLOW_S, PACKETS = 3, 0.03, 12


class Slow:
    """Begins with the third packet; a map of the last 20 ms comes with every later one."""

    def __init__(self, _rig, _config, *, on_pose, on_map, **_more):
        self.on_pose, self.on_map, self.pushed = on_pose, on_map, 0

    def push(self, _events, t_us):
        self.pushed += 1
        if self.pushed < BEGINS:
            return None
        time.sleep(SLOW_S)
        self.on_pose(None)
        self.on_map(SimpleNamespace(window=SimpleNamespace(t1_us=t_us - 20_000)))
        return "a pose"


@pytest.mark.parametrize("packet_us", [10_000, 100_000])
def test_who_is_slower_than_the_recording_falls_behind(monkeypatch, packet_us):
    monkeypatch.setattr(track_latency, "Tracker", Slow)
    recording = SimpleNamespace(rig=None, depth_range_m=None)
    packets = [(packet_us * (k + 1), []) for k in range(PACKETS)]
    fast, live = (fed(recording, packets, None, paced=paced) for paced in (False, True))
    later, packet_s = PACKETS - BEGINS, 1e-6 * packet_us
    assert len(live.poses_s) == len(live.maps_s) == later
    assert min(fast.begin_s, live.begin_s) >= SLOW_S
    assert fast.wall_s >= SLOW_S / packet_s
    assert fast.cpu_s < fast.wall_s
    assert live.wall_s >= max(SLOW_S / packet_s, 1)
    # Whatever comes before its turn waits; what takes longer than a packet adds up.
    behind_s = later * (SLOW_S - packet_s) if packet_s < SLOW_S else SLOW_S
    assert live.poses_s[-1] >= behind_s
    assert min(m - p for m, p in zip(live.maps_s, live.poses_s, strict=True)) >= 0.02

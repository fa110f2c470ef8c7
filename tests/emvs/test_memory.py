"""What the mapper may use: a whole 1 Mpx pair in less memory than one volume of it."""

import pytest

from peak_memory import peak_mb

CODE = """
import sys
import numpy as np
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window

N = int(sys.argv[1])
CAMERA = Camera(1280, 720, 1050, 1050, 639.5, 359.5)
T_body_right = np.eye(4)
T_body_right[0, 3] = 0.12

class Noise:
    name, depth_range_m = "noise", (0.45, 4.0)
    rig = Rig("pair", (CAMERA, CAMERA), (np.eye(4), T_body_right))
    path_m = np.array([[0.0, 0, 0], [0.25, 0, 0]])
    trajectory = Trajectory(np.array([0, 500_000]), path_m, np.tile([0.0, 0, 0, 1], (2, 1)))

    def event_span_us(self, camera):
        return 0, 500_000

    def events(self, camera, t0_us, t1_us):
        rng = np.random.default_rng(camera)
        t_us = np.linspace(0, 499_999, N).astype(np.int64)
        x, y = rng.integers(0, 1280, N, np.uint16), rng.integers(0, 720, N, np.uint16)
        return Events(x, y, t_us, np.zeros(N, np.uint8)).between(t0_us, t1_us)

methods = tuple(sys.argv[2:])
result = map_window(Noise(), MapperConfig(planes=100, methods=methods))
assert sum(counts.events.rays for counts in result.counts) == 2 * N
assert len(result.depth_maps) == len(methods)
"""


PAPER = tuple(f"Alg1/{name}" for name in ("min", "H", "G", "A", "RMS", "max"))


@pytest.mark.slow
@pytest.mark.parametrize("methods", [(*PAPER, "EMVS/cam0", "EMVS/cam1"), ("Learned/H",)])
def test_mapping_a_1_mpx_pair_stays_below_700_mb(methods):
    peak_mb(CODE, ["100000", *methods])  # compiles: that takes memory of its own
    assert peak_mb(CODE, ["4000000", *methods]) < 700

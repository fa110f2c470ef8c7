"""The network's results do not depend on how wide the processor's vectors are."""

from pathlib import Path

import pytest

from programs import NARROW, assert_same_bits

SAME = """
import numpy as np
from lanes import as_rays
from eventsweep.plugins.learned.networks.network import CHANNELS, CUES, DEPTH, SIDE_PX, network
from eventsweep.emvs.utils.vectors_kernels import WIDTH
rng = np.random.default_rng(0)
shares = rng.gamma(0.5, 0.5, (21, len(CHANNELS), DEPTH, SIDE_PX, SIDE_PX)).astype(np.float32)
judged = network().judge(as_rays(shares), rng.normal(size=(21, len(CUES))).astype(np.float32))
print(WIDTH, *(one.tobytes().hex() for one in judged))
"""


@pytest.mark.slow
@pytest.mark.parametrize("told", NARROW)
def test_a_processor_with_shorter_vectors_finds_the_same_bits(told, tmp_path):
    assert_same_bits(SAME, told, tmp_path, [Path(__file__).parent])

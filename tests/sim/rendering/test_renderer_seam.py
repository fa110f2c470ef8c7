"""Another renderer in MuJoCo's place, and the unchanged simulator around it."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.errors import InputError
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate
from formula_wall import SCENE, WALL_M, Formula, Wall, behind_the_wall, sideways
from tiers import often

RIG, EPS = made.tiny_rig(), 0.1


@pytest.mark.parametrize(
    ("sampling", "workers"),
    often([("linear", 1), ("accurate", 2)], product(["linear", "accurate"], [1, 2])),
)
def test_events_and_depth_are_those_of_the_formula(tmp_path, sampling, workers):
    """At every pixel the events' steps add up to the change of the formula's logarithm."""
    config = SimConfig(sampling=sampling, duration_s=0.1, log_eps=EPS, truth=("segmentation",))
    out = simulate(SCENE, RIG, config, 0, tmp_path / "s", workers=workers, drawing=Formula())
    sequence = Sequence.open(out)
    drawn = Wall(RIG, 1, None) if sampling == "linear" else Wall(RIG, 8, 0)
    assert sequence.manifest.renderer == "a formula"
    for k in range(2):
        events = sequence.events(k, 0, 100_001)
        assert len(events) > 500
        np.testing.assert_array_equal(sequence.truth_depth_m(k, 100_000), WALL_M)
        assert not sequence.truth_dynamic(k, 0).any()
        ends = [
            np.log(drawn.frame(k, sideways(0.1, 0).T_world_body(t_s)).intensity + EPS)
            for t_s in (0.0, 0.1)
        ]
        sums = np.zeros(ends[0].shape)
        step = np.where(events.p > 0, config.contrast_threshold_pos, -config.contrast_threshold_neg)
        np.add.at(sums, (events.y, events.x), step)
        largest = max(config.contrast_threshold_pos, config.contrast_threshold_neg)
        assert np.abs(sums - (ends[1] - ends[0])).max() <= largest + 1e-3


def test_a_camera_inside_something_is_refused_in_the_renderers_words(tmp_path):
    scene = replace(SCENE, motion=behind_the_wall)
    with pytest.raises(InputError, match="starts inside 'wall'"):
        simulate(scene, RIG, SimConfig(), 0, tmp_path / "s", drawing=Formula())

"""A real DAVIS240C: what is fitted to one half of its recording holds for the other."""

import pytest

from eventsweep.emvs.datasets import open_recording
from eventsweep.plugins.diagnose.sensing.fit import counts_of, fit_sensor
from eventsweep.plugins.diagnose.sensing.frames import frames_of
from places import ROOT

SLIDER = ROOT.parent / "shared" / "data" / "slider_depth"


@pytest.mark.slow
@pytest.mark.skipif(not SLIDER.exists(), reason="needs ../shared/data/slider_depth")
def test_the_second_half_has_as_many_events_as_the_first_half_leads_one_to_expect():
    recording = open_recording(SLIDER)
    first_us, last_us = recording.event_span_us(0)
    middle_us = (first_us + last_us) // 2
    fit = fit_sensor(recording, 0, (first_us, middle_us))
    frames = frames_of(recording, 0, (middle_us, last_us))
    begin_us, end_us = (int(t) for t in frames.t_us[[0, -1]])
    seen = len(recording.events(0, begin_us + 1, end_us + 1))
    assert counts_of(frames, fit.values()).sum() == pytest.approx(seen, rel=0.15)
    assert 0.3 < fit.config().contrast_threshold_neg < fit.config().contrast_threshold_pos < 0.8

"""What the public function refuses before it reads anything."""

import pytest

import eventsweep as es
from refusals import refused


@pytest.mark.parametrize(("call", "words"), [
    (lambda: es.video_to_events("nowhere", "o"), "nowhere: no such file or folder"),
    (lambda: es.video_to_events("x", "o", es.MapperConfig()), "needs PixelConfig"),
    (lambda: es.video_to_events("x", "o", seed=0.5), "seed is 0.5"),
])  # fmt: skip
def test_bad_input_is_refused_in_one_line(call, words):
    refused(words, call)

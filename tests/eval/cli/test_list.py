"""`eventsweep list`: all that is chosen by name, from the registries, for eyes and programs."""

import json

import pytest

from eventsweep import scenes
from eventsweep.emvs import methods
from eventsweep.eval.cli.main import main
from eventsweep.eval.cli.names import KINDS
from eventsweep.eval.scoring.trajectories.metrics import KNOWN_METRICS
from eventsweep.eval.studies.definitions import STUDIES
from eventsweep.eval.suite import definition
from eventsweep.sim.motion.head_styles import STYLES
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.sensor_presets import PRESETS


def listed(capsys, *words):
    assert main(["list", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_every_registry_is_listed_whole_or_as_asked_for(capsys):
    found = {kind: set(lines) for kind, lines in listed(capsys).items()}
    assert list(found) == list(KINDS)
    suites = found.pop("suites")
    whole = {
        "scenes": scenes.names(), "rigs": RIGS, "sensors": PRESETS, "head-styles": STYLES,
        "methods": methods.overview(), "metrics": KNOWN_METRICS, "studies": STUDIES,
    }  # fmt: skip
    assert {kind: found[kind] for kind in whole} == {kind: set(one) for kind, one in whole.items()}
    for name in suites:
        definition.load(name)
    assert {"quick", definition.GATED} <= suites
    assert list(listed(capsys, "rigs", "scenes")) == ["rigs", "scenes"]


@pytest.mark.parametrize("kind", KINDS)
def test_one_kind_is_a_line_for_each_name_with_what_it_is(capsys, kind):
    lines = listed(capsys, kind)[kind]
    assert all(text and "\n" not in text for text in lines.values())
    assert main(["list", kind]) == 0
    title, *printed = capsys.readouterr().out.strip().splitlines()
    assert title.strip() == kind
    assert [line.split("  ")[0].strip() for line in printed] == list(lines)  # fits `grep`
    told = zip(printed, lines.items(), strict=True)
    assert all(line.strip().endswith(text) for line, (_, text) in told)


def test_a_method_of_ones_own_is_listed(capsys):
    from eventsweep.emvs.methods.method import Method

    methods.register(Method.from_function("Mine/listed", lambda votes: votes[:, 0].min(0), "mine"))
    try:
        assert listed(capsys, "methods")["methods"]["Mine/listed"] == "mine"
    finally:
        methods.unregister("Mine/listed")

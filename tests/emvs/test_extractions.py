"""A method is a fusion and an extraction: what extractions ask for, and those of other packages."""

from dataclasses import replace

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import (
    EXTRACTIONS,
    families,
    known_methods,
    methods_by_name,
    named,
    overview,
    register,
    unregister,
)
from eventsweep.emvs.methods.method import BY_VOTES, Extraction, Method
from point_world import fronto_parallel
from refusals import refused

FORMER = {
    "focus_measure": "gradient", "focus_sigma_px": 1.5, "focus_threshold_kernel_px": 7,
    "focus_threshold_c": 3.0, "focus_reliability": 0.1, "learned_error_px": 0.25,
    "learned_weights": "mine.npz", "derd_threshold_kernel_px": 9, "derd_threshold_c": 4.0,
    "derd_weights": "theirs.npz",
}  # fmt: skip


class Upper(Extraction):
    """The upper half of the map by votes; asks for all that can be asked for."""

    family, grammar, how = "Upper", "Upper/<F>", ", upper half"
    summary, examples = "the upper half of an image", ("Upper/H",)
    per_camera = keeps_votes = needs_baseline = True

    def measure(self, config):
        return "gradient"

    def check(self, config):
        if config.median_px == 1:
            raise InputError("Upper without a median: set median_px")

    def extract(self, method, swept):
        focus = swept.result.focus[method.name]
        assert len(focus.camera_maxima) == (2 if method.fusion.camera is None else 0)
        assert swept.votes_of_planes.codes.shape[0] == 2
        assert swept.known_per_rho_px > 0
        plain = BY_VOTES.extract(method, replace(swept, result=replace(swept.result, focus={})))
        mask = plain.mask.copy()
        mask[len(mask) // 2 :] = False
        return replace(plain, mask=mask)


@pytest.fixture
def upper():
    register(Upper())
    yield
    unregister("Upper")


@pytest.mark.usefixtures("upper")
def test_an_extraction_of_another_package_works_with_every_fusion():
    names = ("Alg1/H", "Upper/H", "Upper/cam1", "Upper/AtHc@2")
    result = map_window(fronto_parallel(1.2), MapperConfig(methods=names, planes=20))
    assert tuple(result.depth_maps) == names
    mine, ours = result.depth_maps["Upper/H"], result.depth_maps["Alg1/H"]
    half = len(ours.mask) // 2
    assert mine.points > 0
    assert not mine.mask[half:].any()
    np.testing.assert_array_equal(mine.mask[:half], ours.mask[:half])
    np.testing.assert_array_equal(mine.depth_m, ours.depth_m)
    assert named("Upper/H").summary == "harmonic mean across cameras, upper half"
    assert "Upper/<F>" in overview()


@pytest.mark.usefixtures("upper")
def test_what_an_extraction_refuses_is_refused_before_any_work():
    config = MapperConfig(methods=("Upper/H",), planes=20, median_px=1)
    refused("Upper without a median", map_window, fronto_parallel(1.2), config)
    refused("names are Upper/<F>", methods_by_name, ("Upper/median",), 2)
    refused("registered already", register, Upper())


def test_an_extraction_takes_a_function_of_votes():
    method = Method.from_function(
        "Mine/least", lambda votes: votes[:, 0].min(axis=0), "least", extraction=Upper()
    )
    register(method)
    try:
        config = MapperConfig(methods=("Mine/least", "Alg1/min"), planes=20)
        maps = map_window(fronto_parallel(1.2), config).depth_maps
    finally:
        unregister("Mine/least")
    np.testing.assert_array_equal(maps["Mine/least"].depth_m, maps["Alg1/min"].depth_m)


@pytest.mark.parametrize("family", ["Focus", "Alg1", "two words", ""])
def test_families_that_are_taken_or_no_names_are_refused(family):
    extraction = Upper()
    extraction.family = family
    refused("family name", register, extraction)


def test_every_extraction_builds_its_examples_and_nothing_else():
    assert {extraction.family for extraction in EXTRACTIONS} >= {"Focus", "Late"}
    registered = [each for each in families().values() if isinstance(each, Extraction)]
    for extraction in {*EXTRACTIONS, *registered}:
        for name in extraction.examples:
            assert extraction.build(name).extraction is extraction
        refused("unknown method", extraction.build, f"{extraction.family}/median")


def test_methods_of_one_fusion_share_a_volume():
    by_name = {method.name: method for method in known_methods(2)}
    assert by_name["Focus/H"].fusion == by_name["Alg1/H"].fusion
    assert by_name["Focus/H"] != by_name["Alg1/H"]


def test_former_names_of_grouped_settings_are_read():
    """Suites, maps and settings files of earlier versions have them."""
    config = MapperConfig.model_validate(FORMER)
    for name, value in FORMER.items():
        group, _, field = name.partition("_")
        assert str(getattr(getattr(config, group), field)) == str(value)
    assert MapperConfig.model_validate(config.model_dump(mode="json")) == config
    mixed = MapperConfig.model_validate({"focus": {"sigma_px": 2.0}, "focus_measure": "dog"})
    assert (mixed.focus.sigma_px, mixed.focus.measure) == (2.0, "dog")


def test_the_removed_setting_of_gpus_is_read_and_told_of_where_it_mattered(caplog):
    assert MapperConfig.model_validate({"voting_precision": "fixed"}) == MapperConfig()
    assert caplog.messages == []
    assert MapperConfig.model_validate({"voting_precision": "float"}) == MapperConfig()
    assert caplog.messages == ["voting_precision float is ignored: GPUs sum votes as integers now"]
    refused("unknown key voting_precision", MapperConfig, voting_precision="double")

"""Every method looks the same wherever it is drawn, and unlike every other, colour or no colour."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D

from eventsweep.emvs.baselines import BASELINES, BaselineEstimator, sgm
from eventsweep.emvs.methods import named, register, unregister
from eventsweep.emvs.methods.method import Method
from eventsweep.eval.figures.colormaps import INK, line_style
from eventsweep.eval.report.window_page import confidence_unit

SWEPT = [f"Alg1/{name}" for name in ("min", "H", "G", "A", "RMS", "max")]
TOGETHER = [
    *SWEPT, "EMVS/cam0", "EMVS/cam1", "Focus/H", "Focus/cam0", "Alg2/AtHc@4", "Late/union",
    *(baseline.name for baseline in BASELINES),
]  # fmt: skip


def test_without_colour_methods_still_differ_and_families_by_marker():
    styles = {name: line_style(name) for name in TOGETHER}
    pairs = list(itertools.combinations(styles, 2))
    dashes = {name: (style.dash, style.marker) for name, style in styles.items()}
    assert [(a, b) for a, b in pairs if dashes[a] == dashes[b]] == []
    same = [(a, b) for a, b in pairs if styles[a].colour == styles[b].colour]
    assert [(a, b) for a, b in same if a.split("/")[0] != b.split("/")[0]] == []
    families = {name.split("/")[0]: line_style(name).marker for name in TOGETHER}
    marked = [marker for family, marker in families.items() if family != "Alg1"]
    assert "" not in marked
    assert len(set(marked)) == len(marked)


@pytest.mark.parametrize(("name", "expected"), [
    ("Alg1/H", "votes"), ("EMVS/cam7", "votes"), ("Alg2/AtHc@4", "votes"),
    ("Focus/AtHc@2~", "votes"), ("Late/union", "votes"), ("SGM/ts", "time surface, 0..1"),
    ("ESVO/window", "1 / σ of inverse depth, m"), ("Given/H", "own unit"),
    ("Given/cam0", "own unit"), ("Alg2/nothing", "own unit"), ("H", "own unit"),
])  # fmt: skip
def test_the_method_says_what_its_confidence_is(name, expected):
    assert confidence_unit(name) == expected


def test_a_registered_method_says_it_too():
    register(Method.from_function("Mine/last", lambda votes: votes[-1, -1], "the last camera"))
    estimate, unit = sgm.estimate_time_surfaces, "grey levels"
    register(BaselineEstimator("Mine/stereo", "SGM", estimate, confidence=unit))
    names = ("Mine/last", "Mine/stereo")
    try:
        assert [confidence_unit(name) for name in names] == ["own unit", unit]
        assert {named(name).family for name in names} == {"Mine"}
    finally:
        for name in names:
            unregister(name)


@given(st.text(max_size=30))
def test_any_name_has_a_style_that_can_be_drawn(name):
    style = line_style(name)
    assert style == line_style(name)
    to_rgb(style.colour)
    Line2D([0], [0], color=style.colour, linestyle=style.dash, marker=style.marker)


def test_lines_are_seen_on_white_and_on_dark_those_of_others_in_their_own_colours():
    """Contrast by WCAG, against the page's two grounds."""
    styles = {line_style(name) for name in (*TOGETHER, *(f"Given/method{k}" for k in range(20)))}
    assert {style.css for style in styles if style.colour == INK} <= {"currentColor"}
    coloured = {style.colour for style in styles} - {INK}
    assert len(coloured) > 10
    for ground in ("#ffffff", "#14171a"):
        assert [colour for colour in coloured if contrast(colour, ground) <= 2] == []
    given = {line_style(f"Given/method{k}") for k in range(40)}
    ours = {line_style(name).colour for name in TOGETHER}
    assert len(given) > 25
    assert not {style.colour for style in given} & ours
    assert not {style.marker for style in given} & {line_style(name).marker for name in TOGETHER}


def contrast(colour, ground):
    low, high = sorted((luminance(colour), luminance(ground)))
    return (high + 0.05) / (low + 0.05)


def luminance(colour):
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in to_rgb(colour)]
    return sum(w * v for w, v in zip((0.2126, 0.7152, 0.0722), linear, strict=True))

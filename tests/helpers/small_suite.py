"""Definitions of suites that are small enough to run in a test."""

import json

WHOLE, HALVES = ((0.0, 0.04),), ((0.0, 0.02), (0.02, 0.02))


def suite_text(*cases, name="pair", seeds=(0,), mappers=None, more=""):
    """A definition: cases as `case` gives them; mappers are name -> settings."""
    mappers = mappers or {"default": {"methods": ["Alg1/H", "EMVS/cam0"], "planes": 30}}
    head = {
        "name": name, "summary": "short cases", "seeds": seeds, "spread_seeds": seeds,
        "metrics": ["points", "mean_error", "median_error"],
    }  # fmt: skip
    parts = [_lines(head)] + [f"[mappers.{key}]\n{_lines(one)}" for key, one in mappers.items()]
    return "\n".join([*parts, *cases, more])


def case(name, windows=HALVES, seconds=0.04, *, rig="rpg", **more):
    """One case of the scene `planes`; windows are (begin, length), s."""
    settings = {
        "scene": "planes", "rig": rig, "seconds": seconds,
        "windows": [{"start_s": start, "duration_s": length} for start, length in windows],
        "sim": {"contrast_threshold_pos": 0.4, "contrast_threshold_neg": 0.5}, **more,
    }  # fmt: skip
    return f"[cases.{name}]\n{_lines(settings)}"


def _lines(settings):
    return "".join(f"{key} = {_toml(value)}\n" for key, value in settings.items())


def _toml(value):
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(one)}" for key, one in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)

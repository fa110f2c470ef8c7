"""The registry of methods: Algorithms 1 and 2, focus, baselines, and methods of one's own.

The name of an Algorithm 2 is a composition of functions and reads as in the paper: in `AtHc@4` the
harmonic mean across cameras (`Hc`) comes first, in each of 4 sub-intervals, then the arithmetic
mean over time (`At`). In `HcAt@4` each camera's votes are averaged over time first.

A package offers methods of its own in its `pyproject.toml`; the function takes nothing and calls
`register`:

    [project.entry-points."eventsweep.methods"]
    mine = "my_package.eventsweep:register_methods"
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from eventsweep.emvs import baselines
from eventsweep.emvs.baselines import BaselineEstimator, DepthEstimator
from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.dsi.method import (
    CODES,
    MEANS,
    Method,
    MethodName,
    Split,
    single_camera,
    single_cameras,
)
from eventsweep.emvs.errors import InputError, check_type, check_whole
from eventsweep.emvs.utils.plugins import files_of, run_point

# What a name stands for: one way to a volume, or what makes its depth map without any
AnyMethod = Method | DepthEstimator
GROUP = "eventsweep.methods"
_NAME = re.compile(r"\w[\w.+@~-]*(/[\w.+@~-]+)+")
MAX_INTERVALS = 64
ALG2_GRAMMAR = (
    "Alg2/<F>t<F>c@n[/time][~] or Alg2/<F>c<F>t@n[/time] with <F> of min, H, G, A, RMS, max"
)
ALG2_SUMMARY = (
    "fused across cameras (c) and over n sub-intervals of equal count (/time: equal time), the "
    "right-hand fusion first; ~ pairs sub-intervals half a window apart"
)
ALG2_EXAMPLES = ("Alg2/AtHc@4", "Alg2/HcAt@2/time", "Alg2/AtHc@2~")
_F = "min|max|RMS|H|G|A"
_PATTERN = re.compile(rf"Alg2/({_F})([ct])({_F})([ct])@([1-9]\d*)(/time)?(~)?")
_AXIS = {"c": "across cameras", "t": "over time"}
FOCUS_GRAMMAR = "Focus/<F>, Focus/camK or Focus/<an Algorithm 2, such as AtHc@4>"
FOCUS_SUMMARY = (
    "our own: depth where the fused rays are most in focus, kept where cameras and neighbours "
    "agree; camK: one camera, without agreement"
)
FOCUS_EXAMPLES = ("Focus/H", "Focus/cam0", "Focus/AtHc@4")
LEARNED_GRAMMAR = "Learned/<F> or Learned/camK"
LEARNED_SUMMARY = (
    "our own: Focus, and a small network that looks at the votes around, corrects the depth and "
    "says how wrong it may be"
)
LEARNED_EXAMPLES = ("Learned/H", "Learned/cam0")
DERD_SUMMARY = "DERD-Net (published): a recurrent network reads all 100 planes around a pixel"
_ALGORITHM_1 = ("Alg1", "EMVS")
_registered: dict[str, AnyMethod] = {}


def methods_by_name(
    names: Sequence[str], n_cameras: int, *, mcemvs: bool = False
) -> tuple[AnyMethod, ...]:
    """Looks methods up by name.

    Args:
        names: method names; `all` stands for what `known_methods` lists, `baselines` for the
            methods of `emvs.baselines` that need nothing but events, `everything` for both and the
            late fusion.
        n_cameras: cameras of the rig.
        mcemvs: the compatibility setting.

    Returns:
        The methods, each once: first those of `known_methods`, in its order; then the others, in
        the order of their names here.

    Raises:
        InputError: a name that is not known for this number of cameras, or H in the compatibility
            setting with other than two cameras.
    """
    known = known_methods(n_cameras, mcemvs=mcemvs)
    names = [one for name in names for one in baselines.GROUPS.get(name, (name,))]
    others = [name for name in dict.fromkeys(names) if name not in {m.name for m in known}]
    if any(name != "all" for name in others):
        load()
    extra = tuple(_find(name, n_cameras, mcemvs) for name in others if name != "all")
    chosen = (*(m for m in known if "all" in names or m.name in names), *extra)
    if n_cameras != 2:
        _check_no_pair_mean(chosen, n_cameras)
    return chosen


def with_volume(chosen: Sequence[AnyMethod]) -> tuple[Method, ...]:
    """Those that turn votes into a volume, in their order; the others are `DepthEstimator`s."""
    return tuple(method for method in chosen if isinstance(method, Method))


def known_methods(n_cameras: int, *, mcemvs: bool = False) -> tuple[Method, ...]:
    """Lists what `all` stands for: Algorithm 1, the single cameras and our own `Focus/H`.

    With one camera there is nothing to fuse. The compatibility setting has no method of ours.

    Args:
        n_cameras: cameras of the rig.
        mcemvs: the compatibility setting, whose H is 2ab / (a + b + 0.1).
    """
    codes = CODES | ({"H": fusion_kernels.HARMONIC_EPS} if mcemvs else {})
    fused = tuple(
        Method(f"Alg1/{name}", code, f"fused across cameras by the {MEANS[name]}")
        for name, code in codes.items()
    )
    single = single_cameras(n_cameras)
    if n_cameras == 1:
        return single
    return fused + single + (() if mcemvs else (build_focus("Focus/H"),))


def named(name: str) -> AnyMethod | None:
    """The method of a name, whatever the rig; None for a name that no method has here.

    It asks for what a method is, not to run it: packages with methods of their own are not loaded.
    """
    camera = MethodName.of(name).camera
    ours = {method.name: method for method in known_methods(2)}
    if camera is not None:
        ours |= {f"EMVS/cam{camera}": single_camera(camera)}
    if name in ours or name in _registered:
        return ours.get(name) or _registered[name]
    family = FAMILIES.get(MethodName.of(name).family)
    try:
        return None if family is None else family.build(name, False)
    except InputError:
        return None


def overview(n_cameras: int = 2) -> dict[str, str]:
    """Every method's name or grammar, and one line on it, for people to choose from.

    Raises:
        InputError: a number of cameras that is not whole.
    """
    check_whole("n_cameras", n_cameras)
    load()
    known = {method.name: method.summary for method in known_methods(n_cameras)}
    families = {
        family.grammar: f"{family.summary}; such as {', '.join(family.examples)}"
        for family in FAMILIES.values()
    }
    return known | families | {method.name: method.summary for method in _registered.values()}


def register(method: AnyMethod) -> None:
    """Adds a method of one's own; from then on it is asked for by its name.

    Args:
        method: such as `Method.from_function("Mine/median", function, "what it does")`; or what
            needs no volume: `BaselineEstimator("Mine/stereo", function, "what it does")`.

    Raises:
        InputError: a name that is taken, reserved, or no name of the form Family/variant.
    """
    made = "what Method.from_function or BaselineEstimator made"
    check_type("method", method, (Method, DepthEstimator), made)
    family = MethodName.of(method.name).family
    ours = (*_ALGORITHM_1, *FAMILIES)
    if not _NAME.fullmatch(method.name) or family in ours:
        raise InputError(
            f"method name {method.name!r}: needs the form Family/variant, with a family other "
            f"than {', '.join(ours)}"
        )
    if method.name in _registered:
        raise InputError(f"method {method.name!r} is registered already: choose another name")
    _registered[method.name] = method


def unregister(name: str) -> None:
    """Removes a method that `register` added; other names are left alone."""
    _registered.pop(name, None)


@cache
def load() -> None:
    """Lets every installed package register its methods, once in a process.

    Raises:
        InputError: one that cannot be imported, or fails.
    """
    for point in entry_points(group=GROUP):
        run_point(point, "its methods {} cannot be registered", lambda register: register())


def files_of_others(names: Sequence[str]) -> tuple[Path, ...]:
    """Files of the packages that offer methods, where a name is none of ours; none is loaded.

    With our own code, they decide what the methods of these names make.
    """
    groups = ("all", *baselines.GROUPS)
    families = {MethodName.of(name).family for name in names if name not in groups}
    return _files() if families - {*_ALGORITHM_1, *FAMILIES} else ()


@cache
def _files() -> tuple[Path, ...]:
    return tuple(files_of(entry_points(group=GROUP)))


def _find(name: str, n_cameras: int, mcemvs: bool) -> AnyMethod:
    if name in _registered:
        return _registered[name]
    family = FAMILIES.get(MethodName.of(name).family)
    method = family.build(name, mcemvs) if family is not None else None
    if method is None or not _fits(method, n_cameras):
        raise _unknown(name, n_cameras)
    return method


def _fits(method: AnyMethod, n_cameras: int) -> bool:
    if not isinstance(method, Method):
        _check_two_cameras(method.name, n_cameras)
        return True
    camera = method.camera()
    return n_cameras > 1 if camera is None else camera < n_cameras


def _check_two_cameras(name: str, n_cameras: int) -> None:
    if n_cameras < 2:
        raise InputError(
            f"{name} matches two cameras, this rig has {n_cameras}: choose EMVS/cam0 or Focus/cam0"
        )


def _check_no_pair_mean(chosen: Sequence[AnyMethod], n_cameras: int) -> None:
    for method in chosen:
        codes = (method.code, method.outer) if isinstance(method, Method) else ()
        if fusion_kernels.HARMONIC_EPS in codes:
            raise InputError(
                f"{method.name} in the mcemvs setting fuses 2 cameras, this rig has {n_cameras}: "
                "choose other methods or compatibility none"
            )


def _unknown(name: str, n_cameras: int) -> InputError:
    known = [method.name for method in known_methods(n_cameras)]
    grammars = [family.grammar for family in FAMILIES.values()] if n_cameras > 1 else ["Focus/cam0"]
    grammars = [grammar for grammar in grammars if grammar not in known]
    available = ", ".join([*known, *grammars, *_registered])
    return InputError(
        f"unknown method {name!r} for {n_cameras} camera(s): choose from {available} or all"
    )


def build_alg2(name: str, mcemvs: bool = False) -> Method:
    """Makes the Algorithm 2 of a name.

    Args:
        name: such as `Alg2/AtHc@4`.
        mcemvs: the compatibility setting, whose H across cameras is 2ab / (a + b + 0.1).

    Raises:
        InputError: a name that does not follow the grammar, or asks for what makes no difference.
    """
    match = _PATTERN.fullmatch(name)
    if match is None:
        raise InputError(f"unknown method {name!r}: Algorithm 2 is named {ALG2_GRAMMAR}")
    outer, outer_axis, inner, inner_axis, count, by_time, shuffle = match.groups()
    _check_alg2(name, outer_axis, inner_axis, int(count), shuffled=shuffle is not None)
    return Method(
        name,
        _alg2_code(inner, inner_axis, mcemvs),
        _alg2_summary(match),
        Split(int(count), "time" if by_time else "count"),
        outer=_alg2_code(outer, outer_axis, mcemvs),
        time_first=inner_axis == "t",
        shuffled=shuffle is not None,
    )


def _check_alg2(name: str, outer_axis: str, inner_axis: str, count: int, *, shuffled: bool) -> None:
    if outer_axis == inner_axis:
        raise InputError(
            f"{name}: fuses twice {_AXIS[inner_axis]}; needs one c and one t, such as Alg2/AtHc@4"
        )
    if count > MAX_INTERVALS:
        raise InputError(f"{name}: {count} sub-intervals; at most {MAX_INTERVALS}")
    if shuffled and (count == 1 or inner_axis == "t"):
        raise InputError(
            f"{name}: shuffling changes nothing here; it needs 2 or more sub-intervals and the "
            "fusion across cameras first, such as Alg2/AtHc@2~"
        )


def _alg2_code(fusion: str, axis: str, mcemvs: bool) -> int:
    if mcemvs and fusion == "H" and axis == "c":
        return fusion_kernels.HARMONIC_EPS
    return CODES[fusion]


def _alg2_summary(match: re.Match[str]) -> str:
    outer, outer_axis, inner, inner_axis, count, by_time, shuffle = match.groups()
    kind = "time" if by_time else "count"
    return (
        f"{count} sub-intervals of equal {kind}{', shuffled' if shuffle else ''}; fused "
        f"{_AXIS[inner_axis]} by the {MEANS[inner]}, then {_AXIS[outer_axis]} by the {MEANS[outer]}"
    )


def build_focus(name: str, mcemvs: bool = False) -> Method:
    """Makes the focus method of a name.

    Args:
        name: such as `Focus/H`.
        mcemvs: the compatibility setting, whose H across cameras is 2ab / (a + b + 0.1).

    Raises:
        InputError: a name that does not follow the grammar.
    """
    _, fused = parts = MethodName.of(name)
    k = parts.camera
    if k is not None and fused == f"cam{k}":
        return Method(name, fusion_kernels.CAMERA + k, f"camera {k} alone, by focus", focus=True)
    if fused in CODES:
        code = fusion_kernels.HARMONIC_EPS if mcemvs and fused == "H" else CODES[fused]
        return Method(name, code, f"{MEANS[fused]} across cameras, by focus", focus=True)
    try:
        method = build_alg2(f"Alg2/{fused}", mcemvs)
    except InputError as error:
        raise InputError(f"unknown method {name!r}: the names are {FOCUS_GRAMMAR}") from error
    return replace(method, name=name, summary=f"{method.summary}; by focus", focus=True)


def build_learned(name: str, mcemvs: bool = False) -> Method:
    """Makes the learned method of a name.

    Args:
        name: such as `Learned/H`.
        mcemvs: the compatibility setting, which has no learned method.

    Raises:
        InputError: a name that does not follow the grammar, or the compatibility setting.
    """
    fused = MethodName.of(name)
    if mcemvs:
        raise InputError(f"{name} does not support the mcemvs setting: choose compatibility none")
    if fused.variant not in CODES and fused.camera is None:
        raise InputError(f"unknown method {name!r}: the names are {LEARNED_GRAMMAR}")
    method = build_focus(f"Focus/{fused.variant}")
    summary = method.summary.replace("by focus", "by focus and a network")
    return replace(method, name=name, summary=summary, learned=True)


def build_derd(name: str = "DERD/H", mcemvs: bool = False) -> Method:
    """Makes the method of the published network.

    Args:
        name: `DERD/H`.
        mcemvs: the compatibility setting, whose H across cameras is 2ab / (a + b + 0.1): what the
            authors' weights were trained on.

    Raises:
        InputError: another name.
    """
    if name != "DERD/H":
        raise InputError(f"unknown method {name!r}: the published network is DERD/H")
    code = fusion_kernels.HARMONIC_EPS if mcemvs else CODES["H"]
    return Method(name, code, f"{MEANS['H']} across cameras, read by DERD-Net", derd=True)


def _late(name: str, _mcemvs: bool) -> Method:
    if name != "Late/union":
        raise InputError(f"unknown method {name!r}: the late fusion is Late/union")
    return Method(name, fusion_kernels.MAX, "the single cameras' maps, joined", late=True)


def _baseline(name: str, mcemvs: bool) -> BaselineEstimator:
    baseline = baselines.baseline(name)
    if baseline is None:
        known = ", ".join(one.name for one in baselines.BASELINES)
        raise InputError(f"unknown method {name!r}: the baselines are {known}")
    if mcemvs:
        raise InputError(f"{name} does not support the mcemvs setting: choose compatibility none")
    return baseline


def _baseline_family(family: str) -> Family:
    own = [baseline for baseline in baselines.BASELINES if baseline.family == family]
    names = tuple(baseline.name for baseline in own)
    summary = "; ".join(baseline.summary for baseline in own)
    return Family(", ".join(names), summary, names, _baseline)


@dataclass(frozen=True)
class Family:
    """Methods whose names follow a grammar, made on request.

    Attributes:
        grammar: how the names are built.
        summary: what they do, in a few words.
        examples: some names.
        build: name and whether the compatibility setting is on, to the method.
    """

    grammar: str
    summary: str
    examples: tuple[str, ...]
    build: Callable[[str, bool], AnyMethod]


# First part of the name -> family. A rig of one camera has only what fuses no cameras.
FAMILIES: dict[str, Family] = {
    "Alg2": Family(ALG2_GRAMMAR, ALG2_SUMMARY, ALG2_EXAMPLES, build_alg2),
    "Focus": Family(FOCUS_GRAMMAR, FOCUS_SUMMARY, FOCUS_EXAMPLES, build_focus),
    "Learned": Family(LEARNED_GRAMMAR, LEARNED_SUMMARY, LEARNED_EXAMPLES, build_learned),
    "DERD": Family("DERD/H", DERD_SUMMARY, ("DERD/H",), build_derd),
    "Late": Family(
        "Late/union",
        "per pixel the most confident camera among those that pass their own threshold",
        ("Late/union",),
        _late,
    ),
} | {family: _baseline_family(family) for family in baselines.FAMILIES}

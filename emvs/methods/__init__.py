"""The registry of methods: every name that mapping knows, and those that plug-ins bring.

A package, or a plug-in of ours, offers methods of its own in its `pyproject.toml`; the function
takes nothing and calls `register`:

    [project.entry-points."eventsweep.methods"]
    mine = "my_package.eventsweep:register_methods"
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint
from itertools import chain
from pathlib import Path

from eventsweep.emvs import baselines
from eventsweep.emvs.baselines import BaselineEstimator, DepthEstimator
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.precision import check_precision
from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.dsi.device import CPU, Device, choose_device
from eventsweep.emvs.dsi.fusion import MEANS, Fusion
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.errors import InputError, check_type, check_whole
from eventsweep.emvs.methods.fusion_names import code_of, named_fusion
from eventsweep.emvs.methods.method import FOCUS, LATE, Extraction, Method, single_camera
from eventsweep.emvs.utils.plugins import METHODS, files_of, is_ours, modules_of, points, run_point

# What a name stands for: a fusion and an extraction, or what makes its depth map without volumes
AnyMethod = Method | DepthEstimator
_log = logging.getLogger(__name__)
_NAME = re.compile(r"\w[\w.+@~-]*(/[\w.+@~-]+)+")
_FAMILY_NAME = re.compile(r"\w[\w.+@~-]*")
_ALGORITHM_1 = ("Alg1", "EMVS")


@dataclass(frozen=True)
class Family:
    """Methods whose names follow a grammar, made on request; an `Extraction` says the same.

    `build` takes a name, and whether the compatibility setting is on.
    """

    grammar: str
    summary: str
    examples: tuple[str, ...]
    build: Callable[[str, bool], AnyMethod]


def _alg2(name: str, mcemvs: bool) -> Method:
    fusion, words = named_fusion(name, mcemvs=mcemvs)
    if fusion is None or "@" not in name:
        raise InputError(f"unknown method {name!r}: Algorithm 2 is named {ALG2.grammar}")
    return Method(name, words, fusion)


ALG2 = Family(
    "Alg2/<F>t<F>c@n[/time][~] or Alg2/<F>c<F>t@n[/time] with <F> of min, H, G, A, RMS, max",
    "fused across cameras (c) and over n sub-intervals of equal count (/time: equal time), the "
    "right-hand fusion first; ~ pairs sub-intervals half a window apart",
    ("Alg2/AtHc@4", "Alg2/HcAt@2/time", "Alg2/AtHc@2~"),
    _alg2,
)


def _baseline(name: str, mcemvs: bool) -> BaselineEstimator:
    if name not in baselines.BY_NAME:
        known = ", ".join(baselines.BY_NAME)
        raise InputError(f"unknown method {name!r}: the baselines are {known}")
    if mcemvs:
        raise InputError(f"{name} does not support the mcemvs setting: choose compatibility none")
    return baselines.BY_NAME[name]


def _baseline_family(family: str) -> Family:
    own = {b.name: b.summary for b in baselines.BASELINES if b.family == family}
    return Family(", ".join(own), "; ".join(own.values()), tuple(own), _baseline)


# Extractions of the core whose methods are asked for by name; a new one is added here.
EXTRACTIONS: tuple[Extraction, ...] = (FOCUS, LATE)
# First part of the name -> family. A rig of one camera has only what fuses no cameras.
FAMILIES: Mapping[str, Family | Extraction] = {
    "Alg2": ALG2,
    **{extraction.family: extraction for extraction in EXTRACTIONS},
    **{family: _baseline_family(family) for family in baselines.FAMILIES},
}
# What plug-ins, or a user's own code, registered: methods and extractions by name
_registered: dict[str, AnyMethod | Extraction] = {}
_loaded: set[EntryPoint] = set()


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
    names = [each for name in names for each in baselines.GROUPS.get(name, (name,))]
    others = [name for name in dict.fromkeys(names) if name not in {m.name for m in known}]
    if any(name != "all" for name in others):
        load()
    extra = tuple(_find(name, n_cameras, mcemvs) for name in others if name != "all")
    chosen = (*(m for m in known if "all" in names or m.name in names), *extra)
    for method in with_volume(chosen) if n_cameras != 2 else ():
        if fusion_kernels.HARMONIC_EPS in (method.fusion.code, method.fusion.outer):
            raise InputError(
                f"{method.name} in the mcemvs setting fuses 2 cameras, this rig has {n_cameras}: "
                "choose other methods or compatibility none"
            )
    return chosen


def with_volume(chosen: Sequence[AnyMethod]) -> tuple[Method, ...]:
    """Those that turn votes into a volume, in their order; the others are `DepthEstimator`s."""
    return tuple(method for method in chosen if isinstance(method, Method))


def without_volume(chosen: Sequence[AnyMethod]) -> tuple[DepthEstimator, ...]:
    """Those that make their depth maps without votes, in their order."""
    return tuple(method for method in chosen if not isinstance(method, Method))


def device_for_methods(config: MapperConfig, chosen: Sequence[AnyMethod]) -> Device:
    """The device that the configuration names, but the CPU where no method has a volume.

    Baselines have no sweep and always run on the CPU; beside a GPU a line says so.

    Raises:
        InputError: `cuda`, and no GPU that can be used.
    """
    device = choose_device(config.device)
    estimators = [method.name for method in without_volume(chosen)]
    if device.kind == "cpu" or not estimators:
        return device
    names = ", ".join(estimators)
    _log.warning("device %s: baselines run on the CPU: %s", config.device, names)
    return CPU if len(estimators) == len(chosen) else device


def check_methods(config: MapperConfig, chosen: Sequence[AnyMethod]) -> None:
    """Refuses before any work what the methods' extractions cannot do.

    Raises:
        InputError: says what, such as weights that cannot be read or an unknown precision.
    """
    for method in with_volume(chosen):
        method.extraction.check(config)
    if config.min_precision is not None:
        load(ours=True)
    registered = (each for each in _registered.values() if isinstance(each, Extraction))
    own = [table for each in (*EXTRACTIONS, *registered) for table in each.calibrated]
    check_precision(config.min_precision, [method.name for method in chosen], own)


def known_methods(n_cameras: int, *, mcemvs: bool = False) -> tuple[Method, ...]:
    """Lists what `all` stands for: Algorithm 1, the single cameras and our own `Focus/H`.

    With one camera there is nothing to fuse: `Focus/cam0`. The compatibility setting has no method
    of ours.
    """
    single = tuple(map(single_camera, range(n_cameras)))
    if n_cameras == 1:
        return (*single, *(() if mcemvs else (FOCUS.build("Focus/cam0"),)))
    words = {name: f"fused across cameras by the {mean.words}" for name, mean in MEANS.items()}
    fused = (
        Method(f"Alg1/{name}", words[name], Fusion(code_of(name, "c", mcemvs))) for name in MEANS
    )
    return (*fused, *single, *(() if mcemvs else (FOCUS.build("Focus/H"),)))


def named(name: str) -> AnyMethod | None:
    """The method of a name, whatever the rig; None for a name that no method has here.

    It asks for what a method is, not to run it: packages of others are not loaded.
    """
    load(ours=True)
    camera = MethodName.of(name).camera
    ours = {method.name: method for method in known_methods(2)}
    if camera is not None:
        ours |= {f"EMVS/cam{camera}": single_camera(camera)}
    try:
        return ours.get(name) or _built(name, False)
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
    grammars = {
        family.grammar: f"{family.summary}; such as {', '.join(family.examples)}"
        for family in families().values()
    }
    return known | grammars | {m.name: m.summary for m in _registered_methods().values()}


def register(method: AnyMethod | Extraction) -> None:
    """Adds a method, or an extraction with all methods of its family, to those known by name.

    Args:
        method: such as `Method.from_function("Mine/median", function, "what it does")`; or what
            needs no volume: `BaselineEstimator("Mine/stereo", function, "what it does")`; or an
            `Extraction` with a family of its own.

    Raises:
        InputError: a name that is taken, reserved, or no name of the form Family/variant.
    """
    load(ours=True)  # their names come first
    made = "what Method.from_function or BaselineEstimator made, or an Extraction"
    check_type("method", method, (Method, DepthEstimator, Extraction), made)
    if isinstance(method, Extraction):
        name, what, form, pattern = method.family, "family", "Family", _FAMILY_NAME
    else:
        name, what, form, pattern = method.name, "method", "Family/variant", _NAME
    ours = (*_ALGORITHM_1, *FAMILIES)
    if not pattern.fullmatch(name) or MethodName.of(name).family in ours:
        raise InputError(
            f"{what} name {name!r}: needs the form {form}, with a family other than "
            f"{', '.join(ours)}"
        )
    if name in _registered:
        raise InputError(f"method {name!r} is registered already: choose another name")
    _registered[name] = method


def unregister(name: str) -> None:
    """Removes a method or a family that `register` added; other names are left alone."""
    _registered.pop(name, None)


def families() -> dict[str, Family | Extraction]:
    """Those of the core and those registered, by the first part of their names."""
    registered = {n: each for n, each in _registered.items() if isinstance(each, Extraction)}
    return {"Alg2": ALG2, FOCUS.family: FOCUS, **registered, **FAMILIES}


def _registered_methods() -> dict[str, AnyMethod]:
    return {n: each for n, each in _registered.items() if not isinstance(each, Extraction)}


def load(*, ours: bool = False) -> None:
    """Lets plug-ins register their methods, once in a process; with `ours`, only our own plug-ins.

    Raises:
        InputError: one that cannot be imported, or fails.
    """
    for point in points(METHODS):
        if point in _loaded or (ours and not is_ours(point)):
            continue
        _loaded.add(point)  # first: what it registers asks for this
        try:
            run_point(point, "its methods {} cannot be registered", lambda register: register())
        except InputError:
            _loaded.remove(point)
            raise


def code_of_methods(config: MapperConfig) -> tuple[tuple[str, ...], tuple[Path, ...]]:
    """What, beside the core's own code, decides what a configuration's methods make.

    Returns:
        Modules, of baselines and of our own plug-ins, whose code counts by what they import; and
        files: of other packages that offer methods, where a name is none of the core's, and the
        weights of extractions.

    Raises:
        InputError: weights that are not there, or a package that cannot be loaded.
    """
    groups = ("all", *baselines.GROUPS)
    used = {MethodName.of(name).family for name in config.methods if name not in groups}
    modules = baselines.modules_of(config.methods)
    files: tuple[Path, ...] = ()
    if used - {*_ALGORITHM_1, *FAMILIES}:
        load(ours=True)
        modules, files = (*modules, *modules_of(points(METHODS))), _files_of_packages()
    extractions = (each for family, each in families().items() if family in used)
    weights = (each.files(config) for each in extractions if isinstance(each, Extraction))
    return modules, (*files, *chain.from_iterable(weights))


@cache
def _files_of_packages() -> tuple[Path, ...]:
    return tuple(files_of(points(METHODS)))


def _built(name: str, mcemvs: bool) -> AnyMethod | None:
    """The registered method of a name, or what its family builds; None without a family."""
    if name in (registered := _registered_methods()):
        return registered[name]
    family = families().get(MethodName.of(name).family)
    return None if family is None else family.build(name, mcemvs)


def _find(name: str, n_cameras: int, mcemvs: bool) -> AnyMethod:
    method = _built(name, mcemvs)
    if method is None or (name not in _registered and not _fits(method, n_cameras)):
        raise _unknown(name, n_cameras)
    return method


def _fits(method: AnyMethod, n_cameras: int) -> bool:
    if isinstance(method, Method):
        camera = method.fusion.camera
        return n_cameras > 1 if camera is None else camera < n_cameras
    if n_cameras < 2:
        raise InputError(
            f"{method.name} matches two cameras, this rig has {n_cameras}: choose EMVS/cam0 or "
            "Focus/cam0"
        )
    return True


def _unknown(name: str, n_cameras: int) -> InputError:
    known = [method.name for method in known_methods(n_cameras)]
    grammars = [each.grammar for each in families().values()] if n_cameras > 1 else ["Focus/cam0"]
    names = dict.fromkeys([*known, *grammars, *_registered_methods()])
    return InputError(
        f"unknown method {name!r} for {n_cameras} camera(s): choose from {', '.join(names)} or all"
    )

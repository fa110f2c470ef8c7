"""The one place that chooses a graphics library and imports MuJoCo."""

from __future__ import annotations

import ctypes.util
import importlib
import os
import sys
from typing import Any

from eventsweep.emvs.errors import InputError, heed_interrupt
from eventsweep.emvs.utils.plugins import RENDERERS, points
from eventsweep.sim.graphics.choice import (
    NOTE,
    Choice,
    Driver,
    choose,
    equal_devices,
    has_gpu,
    probe,
)

# What each back end loads (any one of each group), in order of preference. EGL needs no display
# and uses a GPU where there is one.
_LIBRARIES = {"egl": (("EGL",), ("OpenGL", "GL")), "osmesa": (("OSMesa",),)}
_CURE = "install one, on Debian: apt-get install libegl1 libgl1 libosmesa6"


def backend() -> str:
    """Returns the graphics back end: `MUJOCO_GL` where set, else what the machine can do.

    Raises:
        InputError: `MUJOCO_GL` names no usable back end, or nothing is installed.
    """
    return _choice().backend


def import_mujoco(*, draws: bool = True) -> Any:
    """Imports MuJoCo; where there is no graphics library, or it `draws` nothing, without one.

    Raises:
        InputError: a graphics library that does not start.
    """
    if "mujoco" not in sys.modules:
        if not draws:
            return _imported_alone()
        try:
            _choice().adopt()
        except InputError:  # models compile without graphics; `open_context` says what is missing
            return _imported_alone()
    try:
        import mujoco
    except (ImportError, AttributeError, OSError) as error:
        raise _broken(error) from error
    return mujoco


def _imported_alone() -> Any:
    """MuJoCo without its part that draws."""
    asked = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        return importlib.import_module("mujoco")
    finally:
        del os.environ["MUJOCO_GL"]
        if asked is not None:
            os.environ["MUJOCO_GL"] = asked


def open_context(width_px: int, height_px: int) -> Any:
    """Returns a MuJoCo graphics context, made current, for pictures up to that size.

    Raises:
        InputError: no graphics library, or one that gives no context.
    """
    import_mujoco()
    try:
        _choice().adopt()
        # Not mujoco.GLContext: that is fixed by whoever imported MuJoCo first.
        context = importlib.import_module(f"mujoco.{backend()}").GLContext(width_px, height_px)
        context.make_current()
    except InputError:
        raise
    except Exception as error:  # PyOpenGL raises its own zoo, from ctypes errors to AttributeError
        raise _broken(error) from error
    return context


def current_driver() -> Driver:
    """What draws in the context that is current."""
    gl = importlib.import_module("OpenGL.GL")
    said = (gl.glGetString(name) for name in (gl.GL_VENDOR, gl.GL_RENDERER, gl.GL_VERSION))
    return Driver(*(text.decode(errors="replace") for text in said))


def drawn_by() -> str:
    """What decides the pixels that this machine draws, found out in a process of its own.

    Raises:
        InputError: no graphics library, or one that does not start.
    """
    return _probed_driver().identity


def gpu_draws() -> bool:
    """Whether a GPU draws; where there is one that does not, `note` says why."""
    if not has_gpu():
        return False
    try:
        return _probed_driver().hardware
    except InputError as error:
        os.environ[NOTE] = f"the GPU does not draw ({error})"
        return False


def note() -> str:
    """Why a GPU is not used although there is one; empty where there is nothing to tell."""
    return os.environ.get(NOTE, "")


def worker_devices() -> tuple[int, ...]:
    """The equal GPUs that rendering processes may share among them; empty where there is one.

    Raises:
        InputError: no graphics library, or one that does not start.
    """
    if backend() != "egl" or not has_gpu():
        return ()
    return equal_devices(_probed_driver())


def _choice() -> Choice:
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked and asked not in _LIBRARIES:
        raise InputError(
            f"MUJOCO_GL={asked!r} cannot render off screen: unset it, or use egl or osmesa"
        )
    installed = tuple(filter(_installed, [asked] if asked else _LIBRARIES))
    if not installed:
        wanted = f"MUJOCO_GL={asked}" if asked else "EGL or OSMesa"
        raise InputError(f"no graphics library found for {wanted}: {_cure()}")
    return Choice(asked) if asked else choose(installed)


def _probed_driver() -> Driver:
    chosen = _choice()
    chosen.adopt()
    driver = probe(chosen.backend)
    if isinstance(driver, str):
        raise _broken(RuntimeError(driver))
    return driver


def _broken(error: Exception) -> InputError:
    heed_interrupt(error)
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    chosen = os.environ.get("MUJOCO_GL", "egl")
    other = "osmesa" if chosen == "egl" else "egl"
    return InputError(
        f"the graphics library for MUJOCO_GL={chosen} does not start ({reason}): "
        f"try MUJOCO_GL={other}, or {_cure()}"
    )


def _cure() -> str:
    """An end of messages: what to install, and what draws without."""
    others = [point.name for point in points(RENDERERS)]
    return _CURE + (f", or set light.renderer to {others[0]}, which needs none" if others else "")


def _installed(name: str) -> bool:
    return all(any(map(ctypes.util.find_library, group)) for group in _LIBRARIES[name])

"""The one place that chooses a graphics library and imports MuJoCo."""

from __future__ import annotations

import ctypes.util
import importlib
import os
import sys
from typing import Any

from emvs.errors import InputError

# What each back end loads (any one of each group), in order of preference. EGL needs no display
# and uses a GPU where there is one.
_LIBRARIES = {"egl": (("EGL",), ("OpenGL", "GL")), "osmesa": (("OSMesa",),)}
_CURE = "install one, on Debian: apt-get install libegl1 libgl1 libosmesa6"


def backend() -> str:
    """Returns the graphics back end: `MUJOCO_GL` where set, else EGL, else OSMesa.

    Raises:
        InputError: `MUJOCO_GL` names no usable back end, or nothing is installed.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked and asked not in _LIBRARIES:
        raise InputError(
            f"MUJOCO_GL={asked!r} cannot render off screen: unset it, or use egl or osmesa"
        )
    for name in [asked] if asked else _LIBRARIES:
        if _installed(name):
            return name
    wanted = f"MUJOCO_GL={asked}" if asked else "EGL or OSMesa"
    raise InputError(f"no graphics library found for {wanted}: {_CURE}")


def import_mujoco() -> Any:
    """Imports MuJoCo.

    Raises:
        InputError: no graphics library, or one that does not start.
    """
    if "mujoco" not in sys.modules:
        os.environ["MUJOCO_GL"] = backend()
    try:
        import mujoco
    except (ImportError, AttributeError, OSError) as error:
        raise _broken(error) from error
    return mujoco


def open_context(width_px: int, height_px: int) -> Any:
    """Returns a MuJoCo graphics context, made current, for pictures up to that size.

    Raises:
        InputError: no graphics library, or one that gives no context.
    """
    import_mujoco()
    try:
        # Not mujoco.GLContext: that is fixed by whoever imported MuJoCo first.
        context = importlib.import_module(f"mujoco.{backend()}").GLContext(width_px, height_px)
        context.make_current()
    except InputError:
        raise
    except Exception as error:  # PyOpenGL raises its own zoo, from ctypes errors to AttributeError
        raise _broken(error) from error
    return context


def _broken(error: Exception) -> InputError:
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    chosen = os.environ.get("MUJOCO_GL", "egl")
    other = "osmesa" if chosen == "egl" else "egl"
    return InputError(
        f"the graphics library for MUJOCO_GL={chosen} does not start ({reason}): "
        f"try MUJOCO_GL={other}, or {_CURE}"
    )


def _installed(name: str) -> bool:
    return all(any(map(ctypes.util.find_library, group)) for group in _LIBRARIES[name])

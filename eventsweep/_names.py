"""Public names that differ from the names in the modules which define them, and cost little."""

from importlib.metadata import version

from eventsweep.scenes import load as load_scene
from eventsweep.scenes import names as scene_names

__all__ = ["__version__", "load_scene", "scene_names"]

__version__ = version("eventsweep")

"""How the product is laid out, as `docs/architecture.md` says, by the imports in the code."""

import ast
from fnmatch import fnmatchcase

import pytest

from import_graph import (
    PACKAGES,
    by_folder,
    circles,
    import_graph,
    longest_chain,
    read_modules,
    subpackage_graph,
    within,
)
from places import ROOT, needs_plugins
from structure import small_with_one_importer

MOST_MODULES = 15  # in one folder, beside its `__init__`
MOST_FLOORS = 10  # of subpackages of `emvs`, one upon the other
# Of modules in `emvs`; at its foot kernels need `utils.runtime`, and that `utils.kernel_cache`. At
# its head a check maps by way of `sharpness`, as a run does by way of the mapper, and the odometry
# tracks on maps that the mapper makes.
LONGEST_CHAIN = 16

# Folders that are tables: a file for every scene and its parts, a file for every verb.
TABLES = ("scenes", "eval.cli.verbs")

# Small modules with one importer that are an idea of their own, and which.
SMALL = {
    "plugins.diagnose.calibration": "runs a refinement; its page only shows one",
    "eval.stages.beside": "a stage of jobs, too",
    "eval.stages.perturb": "a stage of jobs: its version is that of its own code",
}

# What compiled loops may import besides other kernels: how they are started, codes that they write.
KERNELS_IMPORT = {"emvs.utils.runtime", "plugins.cuda.device", "sim.sensor.labels"}


def is_in_table(name):
    return any(name == table or name.startswith(table + ".") for table in TABLES)


def is_kernels(name):
    return name.endswith("_kernels")


def defines_kernels(tree):
    """Whether a module compiles a function: `@njit`, `@cuda.jit`, with arguments or without."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    marks = [ast.unparse(mark) for function in functions for mark in function.decorator_list]
    return any(mark.partition("(")[0].endswith("jit") for mark in marks)


@pytest.fixture(scope="module")
def modules():
    return read_modules(ROOT)


@pytest.fixture(scope="module")
def graph(modules):
    return import_graph(modules)


def test_no_modules_import_each_other_in_a_circle(graph):
    assert circles(graph) == []


def test_the_subpackages_are_layered(graph):
    assert circles(subpackage_graph(graph)) == []


def test_a_folder_shows_its_parts_at_a_glance(modules):
    folders = by_folder(modules.values())
    sizes = {name: len(inside) - 1 for name, inside in folders.items() if not is_in_table(name)}
    assert {name: size for name, size in sizes.items() if size > MOST_MODULES} == {}


def test_the_mapper_is_not_a_tower(graph):
    chain = longest_chain(within(subpackage_graph(graph), "emvs"))
    assert len(chain) <= MOST_FLOORS, " -> ".join(chain)
    chain = longest_chain(within(graph, "emvs"))
    assert len(chain) <= LONGEST_CHAIN, " -> ".join(chain)


@needs_plugins
def test_what_has_no_idea_of_its_own_is_no_module(modules, graph):
    small = small_with_one_importer(modules, graph)
    # numba keeps what it compiled per file: kernels have files of their own, however small
    stray = {name: by for name, by in small.items() if not is_in_table(name)}
    stray = {name: by for name, by in stray.items() if not is_kernels(name)}
    assert {name: by for name, by in stray.items() if name not in SMALL} == {}
    assert SMALL.keys() <= stray.keys(), "an exception that is none any more"


def test_compiled_loops_lie_in_files_of_their_own(modules):
    loops = [name for name, module in modules.items() if defines_kernels(module.tree)]
    assert len(loops) > 10
    assert [name for name in loops if not is_kernels(name)] == []


def test_compiled_loops_know_nothing_of_the_product(graph):
    imported = {name: graph[name] - KERNELS_IMPORT for name in graph if is_kernels(name)}
    assert len(imported) > 10
    assert {name for names in imported.values() for name in names if not is_kernels(name)} == set()


def test_no_part_of_scenes_imports_a_scene(modules, graph):
    shared = [name for name in graph if fnmatchcase(name, "scenes.parts*")]
    shared += [name for name in graph if fnmatchcase(name, "scenes.textures*")]
    scenes = {name for name in graph if name.startswith("scenes.") and name not in shared}
    assert {name: graph[name] & scenes for name in shared if graph[name] & scenes} == {}


def test_tests_mirror_the_packages():
    folders = [path for name in PACKAGES for path in (ROOT / "tests" / name).rglob("*")]
    mirrored = [ROOT / path.relative_to(ROOT / "tests") for path in folders if path.is_dir()]
    assert len(mirrored) > 10
    assert [path for path in mirrored if path.name != "__pycache__" and not path.is_dir()] == []

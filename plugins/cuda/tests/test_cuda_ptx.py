"""Every GPU kernel passes the GPU's compiler, without a GPU.

Needs what the extra `cuda` brings; skipped where that is not installed. The
translation runs in a process of its own, since it pretends a GPU to numba.
"""

import ast
import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from places import ROOT

TESTS = Path(__file__).parent
CUDA = ROOT / "plugins" / "cuda"
KERNELS = sorted(CUDA.glob("*_kernels.py"))

needs_compiler = pytest.mark.skipif(
    find_spec("numba_cuda") is None or find_spec("nvidia") is None,
    reason="numba-cuda with NVIDIA's compiler is not installed: the extra cuda",
)


@pytest.fixture(scope="module")
def ptx():
    """Kernel's name -> the machine code of each of its uses."""
    simulator = {"NUMBA_ENABLE_CUDASIM": "0"}
    found = subprocess.run(
        [sys.executable, str(TESTS / "cuda_ptx.py")], cwd=ROOT, capture_output=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | simulator, text=True, timeout=600,
        check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr[-5000:]
    kernels = {}
    for use, code in json.loads(found.stdout).items():
        kernels.setdefault(use.split()[0], []).append(code)
    return kernels


def added(code):
    """Types of the atomic additions to the GPU's memory."""
    return set(re.findall(r"\b(?:atom|red)\.global\.add\.(\w+)", code))


def kernels_written():
    """Names of all kernels, read from their modules' text."""
    for module in KERNELS:
        for node in ast.parse(module.read_text()).body:
            if isinstance(node, ast.FunctionDef):
                marks = [ast.unparse(mark) for mark in node.decorator_list]
                if any("cuda.jit" in mark and "device" not in mark for mark in marks):
                    yield node.name


@needs_compiler
def test_every_kernel_is_translated(ptx):
    assert set(ptx) == set(kernels_written())


@needs_compiler
def test_where_a_ray_meets_a_plane_no_product_is_joined_with_its_sum(ptx):
    # Column, row and depth; only a product that is rounded by its own instruction stays alone.
    for kernel in ("vote_fixed", "vote_nearest"):
        assert all(len(re.findall(r"\bmul\.rn\.f32", code)) >= 3 for code in ptx[kernel])


@needs_compiler
def test_no_product_of_a_ray_is_joined_with_its_sum(ptx):
    # Bearing 6, turn 9, origin 15, K and parallax 6
    assert all(len(re.findall(r"\bmul\.rn\.f64", code)) >= 36 for code in ptx["rays"])


@needs_compiler
def test_votes_are_added_in_the_type_that_the_setting_names(ptx):
    # 64-bit integers also count the votes
    for kernel, types in (("vote_fixed", {"u64"}), ("vote_nearest", {"u32", "u64"})):
        assert [added(code) for code in ptx[kernel]] == [types]


@needs_compiler
def test_only_rays_are_computed_in_double_precision(ptx):
    double = {
        name for name, codes in ptx.items() if any(re.search(r"\.f64\b", code) for code in codes)
    }
    assert double == {"rays"}


def test_the_kernels_are_found_where_they_are_written():
    assert {"vote_fixed", "rays", "fold", "blur", "fill"} <= set(kernels_written())

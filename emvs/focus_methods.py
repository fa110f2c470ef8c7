"""Methods whose depth is found by focus, by name: our own extraction over any fusion."""

from __future__ import annotations

from dataclasses import replace

from emvs import alg2
from emvs.dsi import fusion_kernels
from emvs.dsi.method import CODES, MEANS, Method, MethodName
from emvs.errors import InputError

GRAMMAR = "Focus/<F>, Focus/camK or Focus/<an Algorithm 2, such as AtHc@4>"
SUMMARY = (
    "our own: depth where the fused rays are most in focus, kept where cameras and neighbours "
    "agree; camK: one camera, without agreement"
)
EXAMPLES = ("Focus/H", "Focus/cam0", "Focus/AtHc@4")


def build(name: str, mcemvs: bool = False) -> Method:
    """Makes the method of a name.

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
        method = alg2.build(f"Alg2/{fused}", mcemvs)
    except InputError as error:
        raise InputError(f"unknown method {name!r}: the names are {GRAMMAR}") from error
    return replace(method, name=name, summary=f"{method.summary}; by focus", focus=True)

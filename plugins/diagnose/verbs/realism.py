"""`eventsweep realism`: how well a simulated recording can be told from a real one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from eventsweep.eval.cli.app import COMMON, Common, Force, command_line

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Part
    from eventsweep.plugins.diagnose.sensing.realism import Realism


def realism(
    real: Path,
    simulated: Path,
    /,
    *,
    out: Path,
    camera: int = 0,
    force: Force = False,
    common: Common = COMMON,
) -> None:
    """Compare a simulated recording with a real one: intervals, bursts, noise, and one number.

    The number is the AUC of a classifier on event statistics, cross-validated over windows: 0.5
    where it cannot tell them apart, 1 where it always can.

    Args:
        real: A recording of the scene.
        simulated: Its twin, of the same sensor size.
        out: Folder to write: report.html and realism.json.
        camera: Which camera.
    """
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.utils.outputs import atomic_dir, check_output
    from eventsweep.plugins.diagnose.sensing.folder import write_realism
    from eventsweep.plugins.diagnose.sensing.realism import compare_realism

    check_output(out, force=force)
    console = common.console()
    compared = compare_realism(open_recording(real), open_recording(simulated), camera)
    with atomic_dir(out, force=force, inputs=(real, simulated)) as folder:
        write_realism(folder, compared, command_line())
    console.result(compared.facts(), _summary(compared))
    console.wrote(out / "report.html")


def _summary(compared: Realism) -> Iterator[Part]:
    from eventsweep.eval.cli.console import table

    rows = (
        (name, f"{value:.4g}", f"{compared.simulated.statistics[name]:.4g}")
        for name, value in compared.real.statistics.items()
    )
    yield table(f"AUC {compared.auc:.3f}", ("statistic", ">real", ">simulated"), rows)

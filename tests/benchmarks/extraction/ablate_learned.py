"""What the network of Learned/H needs: `python tests/benchmarks ablate_learned --help`.

The network that ships, its depth and its reliability each with the other from the extraction by
focus; and networks that lack an input or a part of the training set, which learn from the samples
that `eventsweep train --out FOLDER` left (`--samples FOLDER`), on a small budget. Those are kept
(`--out`): a stopped run goes on, and a second one only evaluates. All report as many pixels as
Alg1/H; numbers are ratios to those of Alg1/H.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ablated_networks import VARIANTS, Budget, train_missing, trained
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import extract
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.methods.focus import FOCUS as BY_FOCUS
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.networks.judgement import (
    Judgement,
    at_reference_px,
    judge,
    on_own_surface,
)
from eventsweep.plugins.learned.networks.network import Float32s, Network, network
from eventsweep.plugins.learned.training.samples import Shown, shown_of, swept_window
from markdown_blocks import show
from study_cache import load_sequence
from study_extraction import Numbers
from study_learned import BASE, FOCUS, SUMMARY, SUMMARY_RULE, numbers, summary_cells
from study_samples import SETS

METHOD = BY_FOCUS.build(FOCUS)
Ranked = tuple[Float32s, Float32s]  # (M,) disparity, px, and (M,) rank of each candidate


def judged(shown: Shown, net: Network) -> Judgement:
    """What a network makes of a window."""
    return judge(net, shown.method.fusion, shown.kept, shown.chosen, shown.disparity_px)


def _smaller_error(_: Shown, found: Judgement) -> Ranked:
    disparity_px = found.disparity_px
    return disparity_px, at_reference_px(found.reliability, disparity_px)


def _only_reliability(_: Shown, found: Judgement) -> Ranked:
    focus_px = found.chosen.focus_px
    return focus_px, at_reference_px(np.exp(-found.log_error[:, 1]), focus_px)


def _only_depth(shown: Shown, found: Judgement) -> Ranked:
    return found.disparity_px, shown.reliability


def _own_depth(_: Shown, found: Judgement) -> Ranked:
    return found.own_px, at_reference_px(np.exp(-found.log_error[:, 0]), found.own_px)


PARTS: Mapping[str, Callable[[Shown, Judgement], Ranked]] = {
    "`Learned/H`": _smaller_error,
    "its reliability, the depth of `Focus/H`": _only_reliability,
    "its depth, the reliability of `Focus/H`": _only_depth,
    "its own depth at every pixel": _own_depth,
}


def rows(shown: Shown, networks: Mapping[str, Network]) -> Iterator[tuple[str, Ranked]]:
    """Every row of the table, by its title: disparities and ranks of the candidates.

    Args:
        shown: the window, as all networks are shown it.
        networks: those that learnt on a small budget, by their titles.
    """
    yield f"`{FOCUS}`", (shown.chosen.focus_px, shown.reliability)
    found = judged(shown, network())
    for title, part in PARTS.items():
        yield title, part(shown, found)
    for title, net in networks.items():
        yield title, _smaller_error(shown, judged(shown, net))


def outcome(
    sequence: EventSequence, networks: Mapping[str, Network], config: MapperConfig
) -> dict[str, Numbers]:
    """Every row's numbers on one sample, beside those of Alg1/H; its events are swept once."""
    swept = swept_window(sequence, config, METHOD)
    truth = truth_of(sequence, swept.view.t_us, EvalConfig())
    base = extract(BASE, swept.result.maxima[METHOD.name], swept.view, config)
    shown = shown_of(swept, config, METHOD)
    found = {BASE: numbers(base.depth_m, base.mask, truth)}
    for title, ranked in rows(shown, networks):
        found[title] = numbers(*best(shown, smoothed(shown, ranked), base.points), truth)
    return found


def smoothed(shown: Shown, ranked: Ranked) -> Ranked:
    """Depths of a network on their own surfaces; those by focus are already."""
    disparity_px, rank = ranked
    if disparity_px is shown.chosen.focus_px:
        return ranked
    fitted_px, _ = on_own_surface(shown.chosen, disparity_px, shown.kept.codes.shape[2:])
    if rank is shown.reliability:
        return fitted_px, rank
    return fitted_px, rank * np.sqrt(fitted_px / disparity_px)  # as `at_reference_px` has it


def best(shown: Shown, ranked: Ranked, points: int) -> tuple[Float32s, NDArray[np.bool_]]:
    """(H, W) depth, m, and mask of so many candidates, those of the highest rank."""
    disparity_px, rank = ranked
    at, shape = (shown.chosen.rows, shown.chosen.columns), shown.kept.codes.shape[2:]
    depth_m, mask = np.ones(shape, np.float32), np.zeros(shape, np.bool_)
    depth_m[at] = shown.disparity_px[0] / float(shown.view.rho[0]) / disparity_px
    first = np.argsort(-rank, kind="stable")[:points]
    mask[at[0][first], at[1][first]] = True
    return depth_m, mask


def table(outcomes: Sequence[Mapping[str, Numbers]]) -> str:
    """Markdown: one line for each row."""
    names = [name for name in outcomes[0] if name != BASE]
    lines = [f"| Network | {SUMMARY} |", SUMMARY_RULE]
    lines += [f"| {name} | {summary_cells(outcomes, name)} |" for name in names]
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Trains what is not trained yet, evaluates, prints tables; exit code 2 on bad input."""
    chosen = _asked(arguments)
    budget = Budget(chosen.candidates, chosen.epochs)
    with exit_code() as code:
        whole = train_missing(chosen.out, chosen.samples, budget)
        if chosen.page is not None and not whole:
            raise InputError(f"{chosen.page}: gets whole tables only; train the others first")
        found = {one.title: trained(chosen.out, one, budget) for one in VARIANTS}
        networks = {title: net for title, net in found.items() if net is not None}
        text = "\n".join(_titled(name, chosen.cache, networks) for name in chosen.sets)
        show(text, chosen.page, "learned-ablation")
    return code.value


def _titled(name: str, cache: Path, networks: Mapping[str, Network]) -> str:
    """The table of one set of samples, under its name."""
    outcomes = []
    for spec in SETS[name]:
        sequence = load_sequence(
            spec.case, spec.seed, cache, rig=spec.rig, seconds=spec.seconds, sensor=spec.sensor
        )
        outcomes.append(outcome(sequence, networks, MapperConfig()))
    return f"Set `{name}`, {len(outcomes)} samples:\n\n{table(outcomes)}"


def _asked(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks ablate_learned", description=__doc__
    )
    parser.add_argument("--samples", type=Path, help="folder of a finished `eventsweep train`")
    parser.add_argument("--out", type=Path, default=Path("out/ablation"), help="of the networks")
    parser.add_argument("--candidates", type=int, default=Budget().candidates, help="of a window")
    parser.add_argument("--epochs", type=int, default=Budget().epochs)
    parser.add_argument("--sets", nargs="+", default=["held-out", "noisy"], choices=list(SETS))
    parser.add_argument("--cache", type=Path, default=Path("out/study"))
    parser.add_argument("--page", type=Path, help="page whose marked part gets the tables")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

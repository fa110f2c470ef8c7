"""Section 2, the method: events, volumes, their fusion and the depth that is taken from them."""

from __future__ import annotations

import numpy as np

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.eval.results.table import EVENTS
from eventsweep.plugins.paper import means
from eventsweep.plugins.paper.evidence import Evidence
from eventsweep.plugins.paper.means import NOISY, SCENES
from eventsweep.plugins.paper.statements import Chapter, Finding, Statement, Verdict

BAD = "outlier_share"


def _motion(evidence: Evidence) -> Finding:
    sequences = [evidence.view(case).sequence for case in ("boxes-0", "planes-0")]
    share = float(np.mean([_middle_half(sequence) for sequence in sequences]))
    poor, rich = (evidence.number(case, EVENTS, "events") for case in ("low-texture", "desk"))
    return Finding(
        f"The middle half of a straight way gives {100 * share:.0f} % of its events; the almost "
        f"empty room {100 * poor.mean / rich.mean:.0f} % of the desk's",
        Verdict.of(0.4 < share < 0.6 and poor.mean < rich.mean),
    )


def _middle_half(sequence: EventSequence) -> float:
    """Share of camera 0's events that fall into the middle half of the time."""
    first, last = sequence.trajectory.span_us
    quarter = (last - first) // 4
    half = sequence.events(0, first + quarter, last - quarter)
    return len(half) / sequence.event_count(0)


def _continuous(evidence: Evidence) -> Finding:
    view = evidence.view("6dof")
    way_m = float(np.linalg.norm(view.forward))
    first, last = view.sequence.event_span_us(0)
    events = view.sequence.events(0, first, last + 1)
    times = len(np.unique(events.t_us))
    return Finding(
        f"{len(events):,} events of one camera at {times:,} different times, which is one for "
        f"every {1e6 * way_m / times:.2f} µm of its way",
        Verdict.of(times > 10_000),
    )


def _edges(evidence: Evidence) -> Finding:
    view = evidence.view("desk")
    edges = (view.truth.regions["edges"] | view.truth.regions["boundary"]) & view.truth.scored
    found = view.maps["Alg1/H"].mask & view.truth.scored
    on = np.count_nonzero(found & edges) / np.count_nonzero(found)
    everywhere = np.count_nonzero(edges) / np.count_nonzero(view.truth.scored)
    return Finding(
        f"{100 * on:.0f} % of the points lie on edges of texture or depth, which are "
        f"{100 * everywhere:.0f} % of the view (desk)",
        Verdict.of(bool(on > 0.5 and on > 2 * everywhere)),
    )


def _naive(evidence: Evidence) -> Finding:
    ratio = evidence.ratio(SCENES, BAD, "Alg1/H", "Alg1/A")
    noisy = evidence.ratio(NOISY, BAD, "Alg1/H", "Alg1/A")
    alone = {name: evidence.ratio((name,), BAD, "Alg1/H", "Alg1/A") for name in SCENES}
    return Finding(
        f"Outliers of H are {ratio} times those of A, which counts the rays of both cameras in one "
        f"volume; with a DAVIS346's noise {noisy} times",
        Verdict.of(ratio.mean < 1 and noisy.mean < 1, noisy.mean < 0.9),
        f"By scene: {', '.join(f'{name} {found}' for name, found in alone.items())}.",
    )


def _reference_view(evidence: Evidence) -> Finding:
    views = [evidence.view(case) for case in ("6dof", "desk2")]
    off = [abs(2 * view.window.t_us - sum(view.sequence.trajectory.span_us)) for view in views]
    return Finding(
        f"The reference view is camera 0's, at most {max(off) / 2:g} µs from the middle",
        Verdict.of(max(off) <= 2),
        "Volumes and maps equal those of the authors' program on its own example "
        '(`compatibility = "mcemvs"`, [mapper](mapper.md)).',
    )


def _no_coincidence(evidence: Evidence) -> Finding:
    shuffled = evidence.ratio(SCENES, "mean_error", "Alg2/AtHc@4~", "Alg2/AtHc@4")
    alone = evidence.ratio(SCENES, "mean_error", "Alg2/AtHc@4~", "EMVS/cam0")
    matched = evidence.ratio(SCENES, "mean_error", "GTS/events", "Alg1/H")
    return Finding(
        f"With sub-intervals so exchanged that no event of one camera meets one of the other of "
        f"the same time, the mean error is {shuffled} times as large, and {alone} times a single "
        f"camera's; matching coinciding "
        f"events (GTS) has {matched} times the error of H",
        Verdict.of(alone.mean < 1, shuffled.mean < 1.2),
    )


CHAPTER = Chapter(
    "Section 2: from events to depth",
    (
        Statement(
            "Sec. 2, first paragraph",
            "Under constant light the number of events grows with motion and texture",
            _motion,
        ),
        Statement(
            "Sec. 2, first paragraph",
            "A moving camera fires at an almost continuous set of viewpoints",
            _continuous,
        ),
        Statement(
            "Sec. 2, first paragraph", "Maxima of the DSI are where edges in space are", _edges
        ),
        Statement(
            "Sec. 2, second paragraph",
            "A volume for each camera, fused, is better than one that counts the rays of both",
            _naive,
        ),
        Statement("Sec. 2, Eq. 1", "min ≤ H ≤ G ≤ A ≤ RMS ≤ max", means.order),
        Statement(
            "Sec. 2, after Eq. 1",
            "G, H and min, which ask both cameras, reject outliers best",
            means.functions,
            "Tab. 1 of the journal paper",
        ),
        Statement(
            "Alg. 1, Fig. 1",
            "The reference view is that of the left camera in the middle of the interval",
            _reference_view,
        ),
        Statement(
            "Sec. 4", "No events need to coincide for the association of data", _no_coincidence
        ),
    ),
)

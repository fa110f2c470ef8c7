"""The page of a public ranking, `index.html`: one file, which needs no network and no script."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError, repeated
from eventsweep.emvs.utils import release
from eventsweep.emvs.utils.inputs import TABLE_BYTES, check_file, inside, parse_json, read_text
from eventsweep.emvs.utils.outputs import atomic_dir, check_files, files_together, output_folder
from eventsweep.eval.figures.images import data_uri
from eventsweep.eval.report.html import (
    Layer,
    Page,
    Picture,
    Pictures,
    Sentences,
    Text,
    files_in,
    page_text,
    plural,
    provenance,
)
from eventsweep.eval.report.ranking import column
from eventsweep.eval.report.suite_pictures import METHODS_NAME
from eventsweep.eval.results.results import PICTURES_FOLDER
from eventsweep.eval.scoring.standings import RULE, lead_words
from eventsweep.plugins.ranking import summary
from eventsweep.plugins.ranking.entries import (
    DATA_NAME,
    RENDERERS_DIFFER_PERCENT,
    Merged,
    RankingData,
    RankingEntry,
)
from eventsweep.plugins.ranking.pages import sections
from eventsweep.plugins.ranking.pages.method_page import FOLDER as METHODS
from eventsweep.plugins.ranking.pages.method_page import method_page, page_names
from eventsweep.plugins.ranking.pages.sections import RankingPage
from eventsweep.plugins.ranking.sources import Source
from eventsweep.plugins.ranking.summary import MAIN
from eventsweep.plugins.ranking.tracks import OTHERS as TRACKS
from eventsweep.plugins.ranking.tracks import SEMI_DENSE

HTML_NAME = "index.html"
_PICTURE_BYTES = 1 << 22
_RELATIVE = "relative error is the geometric mean over cases of the mean error over true depth"


def write_ranking(sources: Sequence[Source], out: Path, site: str = "") -> RankingPage:
    """Writes `index.html`, `ranking.json` with its data, `methods/` and `pictures/`.

    Args:
        sources: oldest first; of two pictures of a method the later is shown.
        out: the folder to write; it may be that of a source.
        site: address of the documentation, for links to the rules and home; empty for none.

    Returns:
        What the pages say.
    """
    entries = tuple(entry for source in sources for entry in source.entries)
    twice = repeated(entry.label for entry in entries)
    if twice is not None:
        raise InputError(f"two results are called {twice}: name one as in LABEL=RESULT")
    if not any(one.part == "public" for one in entries if one.track == SEMI_DENSE):
        only = (
            "of other tracks" if any(e.track != SEMI_DENSE for e in entries) else "of a hidden part"
        )
        raise InputError(f"only results {only}: give one of a suite's public part as well")
    found = _pictures(sources)
    page = _page_of(entries, found)
    links = _links(site or release.DOCUMENTATION)
    names = (HTML_NAME, DATA_NAME, PICTURES_FOLDER, METHODS)
    with output_folder(out, names, force=True) as folder:
        folder.mkdir(parents=True, exist_ok=True)
        _write_pictures(folder, found)
        _write_methods(folder, page, links)
        with files_together(folder, (DATA_NAME, HTML_NAME)) as staged:
            data = RankingData(entries=entries).to_text() + "\n"
            (staged / DATA_NAME).write_text(data, encoding="utf-8")
            text = page_text(ranking_page(page, files_in(staged, (DATA_NAME,)), links))
            (staged / HTML_NAME).write_text(text, encoding="utf-8")
    return page


def _page_of(entries: tuple[RankingEntry, ...], found: Mapping[str, MethodPictures]) -> RankingPage:
    own = tuple(entry for entry in entries if entry.track == SEMI_DENSE)
    public, hidden = summary.parts(own)
    if not public.cases or not public.complete():
        raise InputError(
            f"{public.base.label}: no method was run on every case that methods are ranked by: "
            "run the suite without --case, or with fewer failures"
        )
    pictures = {method: tuple(one.pictures(method)) for method, one in found.items()}
    ranked = summary.ranked(public)
    names = page_names([standing.method for standing in ranked.standings])
    return RankingPage(
        own,
        ranked,
        summary.ranked(hidden) if hidden and hidden.cases else None,
        pictures,
        {method: f"{METHODS}/{name}" for method, name in names.items()},
        summary.of_tracks(entries),
    )


def _links(site: str) -> tuple[tuple[str, str], ...]:
    """To the rules and home."""
    if not site:
        return ()
    place = site.rstrip("/")
    return ("How to enter", f"{place}/ranking.html#entering"), ("Home", f"{place}/index.html")


def _write_methods(out: Path, page: RankingPage, links: Sequence[tuple[str, str]]) -> None:
    """Writes a page for every ranked method."""
    back = [("Ranking", f"../{HTML_NAME}")]
    back += [(title, to if "://" in to else f"../{to}") for title, to in links]
    with atomic_dir(out / METHODS, force=True, part_of=out) as made:
        for method, address in page.pages.items():
            text = page_text(method_page(page, method, back))
            (made / Path(address).name).write_text(text, encoding="utf-8")


# Pictures


@dataclass(frozen=True)
class MethodPictures:
    """A method's pictures: for best and worst, what they show, and the file's content."""

    about: Mapping[str, Mapping[str, Any]]
    content: Mapping[str, bytes]

    def pictures(self, method: str) -> Iterator[Picture]:
        """As a page shows them."""
        for which, one in self.about.items():
            uri = data_uri("image/webp", self.content[which])
            text = (
                f"{which} case: {one['case']}, {one['abs_rel']:.2f} % error; from the left: depth, "
                f"true depth, error (orange: {one['error_cm']:g} cm)"
            )
            yield Picture(method, (Layer(uri, text),))


def _pictures(sources: Sequence[Source]) -> dict[str, MethodPictures]:
    """The newest pictures of every method; of a hidden part none is shown."""
    found: dict[str, MethodPictures] = {}
    for source in sources:
        if not any(entry.part == "public" for entry in source.entries):
            continue
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError):
            place = inside(source.folder, PICTURES_FOLDER)
            index = parse_json(read_text(inside(place, METHODS_NAME), TABLE_BYTES))
            for method, about in index.items():
                content = {which: _content(place, one["file"]) for which, one in about.items()}
                shown = MethodPictures(about, content)
                if tuple(shown.pictures(method)):  # says all that is shown
                    found[str(method)] = shown
    return found


def _content(place: Path, name: str) -> bytes:
    path = inside(place, Path(name).name)
    check_file(path, _PICTURE_BYTES)
    return path.read_bytes()


def _write_pictures(out: Path, found: Mapping[str, MethodPictures]) -> None:
    if not found:
        return
    check_files(out, (PICTURES_FOLDER,), force=True)
    with atomic_dir(out / PICTURES_FOLDER, force=True, part_of=out) as made:
        for one in found.values():
            for which, about in one.about.items():
                (made / Path(about["file"]).name).write_bytes(one.content[which])
        index = {method: one.about for method, one in found.items()}
        (made / METHODS_NAME).write_text(json.dumps(index, ensure_ascii=False, indent=1))


# The page


def ranking_page(
    page: RankingPage, files: Sequence[str] = (), links: Sequence[tuple[str, str]] = ()
) -> Page:
    """What the page shows; `links` are (title, address) pairs."""
    base = page.joined.base
    shown = (
        *(sections.track(name, found) for name, found in page.tracks.items()),
        *sections.hidden(page), sections.ranks(page), sections.coverage(page),
        sections.conditions(page), sections.scenes(page), *sections.poses(page),
        sections.cost(page), *sections.causes(page), *sections.history(page),
    )  # fmt: skip
    seeds = plural(len(base.seeds), "seed")
    lead, *findings = _findings(page)
    best = page.pictures.get(page.methods[0], ())
    return Page(
        title=f"Ranking, {base.suite}",
        subtitle=f"{plural(len(page.methods), 'method')} on "
        f"{plural(len(page.joined.cases), 'case')} with {seeds} each; sequences: "
        f"{sections.data(base)}.",
        blocks=(
            Text(lead, "lead"),
            Pictures(best[:1], columns=1),
            Sentences(tuple(findings)),
            sections.overview(page),
            Text(f"{_rule()} Click a method for its own page; {_RELATIVE}.", "note"),
        ),
        sections=(*shown, provenance(sections.made(page))),
        version=base.versions.get("eventsweep", ""),
        files=tuple(files),
        links=tuple(links),
    )


def _rule() -> str:
    return RULE.format(title=column(MAIN).title)


def _findings(page: RankingPage) -> Iterator[str]:
    lead = lead_words(page.public.standings, len(page.joined.base.seeds))
    yield f"Semi-dense depth: {lead}" if page.tracks else lead
    for name, found in page.tracks.items():
        yield f"{TRACKS[name].title}: {lead_words(found.standings, len(found.joined.base.seeds))}"
    for entry in page.entries:
        for method, where in entry.perfect.items():
            places = f"{', '.join(where)} ({entry.label})"
            yield f"{method}: a perfect score, as if the truth were copied, in {places}."
    for ranked in filter(None, (page.public, page.hidden)):
        yield from _of_entries(ranked.joined)
    if page.public.lacking:
        lacking = ", ".join(f"{m} ({n})" for m, n in page.public.lacking.items())
        yield f"Not ranked, because some cases are missing: {lacking}."
    for entry in page.entries:
        for job, why in entry.failures.items():
            yield f"Failed in {entry.label}: {job}: {why}"


def _of_entries(joined: Merged) -> Iterator[str]:
    """Which entries are left out, and which are of other pictures."""
    for label, why in joined.refused:
        yield f"{label}: {why}."
    for label in joined.redrawn:
        yield (
            f"{label}: rendered with another graphics library; its mean errors are comparable "
            f"within {RENDERERS_DIFFER_PERCENT:g} %."
        )

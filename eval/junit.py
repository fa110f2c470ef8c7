"""Verdicts as JUnit XML, which every CI reads."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as xml

from emvs.utils.files import atomic_path
from eval.gate import RED, Verdict
from eval.gate_table import sentence

# XML 1.0 has no way at all to write most control characters.
_UNWRITABLE = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(path: Path, verdicts: Sequence[Verdict]) -> None:
    """One test case per number: failed where it is red, skipped where nothing can be compared."""
    red = sum(one.status in RED for one in verdicts)
    skipped = sum(one.status in ("not comparable", "new") for one in verdicts)
    suite = xml.Element("testsuite", name="eventsweep gate", tests=str(len(verdicts)))
    suite.attrib |= {"failures": str(red), "errors": "0", "skipped": str(skipped), "time": "0"}
    for one in verdicts:
        names = {"classname": one.key.case, "name": f"{one.key.method} {one.key.metric}"}
        case = xml.SubElement(suite, "testcase", {k: _clean(v) for k, v in names.items()}, time="0")
        message = _clean(sentence(one))
        if one.status in RED:
            xml.SubElement(case, "failure", type=one.status, message=message)
        elif one.status in ("not comparable", "new"):
            xml.SubElement(case, "skipped", message=message)
    root = xml.Element("testsuites")
    root.append(suite)
    xml.indent(root)
    with atomic_path(path) as partial:
        xml.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def _clean(text: str) -> str:
    return _UNWRITABLE.sub("\ufffd", text).strip()

"""Code in the documentation runs: Python blocks, and `eventsweep` commands in shell blocks."""

import re
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from eventsweep.emvs import methods
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.eval.cli.main import main
from eventsweep.sim.config import SimConfig
from eventsweep.sim.scene import Scene
from eventsweep.sim.simulate import simulate
from places import HAS_PLUGINS, ROOT, of_absent_plug_ins
from places import PAGES as DOCUMENTATION
from tiers import often_named
from twin_checks import smaller

pytestmark = pytest.mark.usefixtures("blank_figures")

PAGES = [ROOT / "README.md", *DOCUMENTATION]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")


READS = {
    "run": {"sim", "map", "score"}, "simulate": {"sim"}, "map": {"map"}, "score": {"score"},
}  # fmt: skip


VERBS, NAMES = map(sorted, of_absent_plug_ins())
ABSENT = re.compile(
    "|".join([*(rf"eventsweep {v}\b" for v in VERBS), *(rf"es\.{n}\b" for n in NAMES)])
)


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text; without a plug-in's folder, not what uses the plug-in."""
    parts = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [part for part in parts if not (VERBS and ABSENT.search(part[1]))]


def without_folder(arguments: list[str]) -> list[str]:
    """A command without its --out, which says where and not what."""
    at = arguments.index("--out") if "--out" in arguments else len(arguments)
    return arguments[:at] + arguments[at + 2 :]


def run_by_the_tutorial() -> list[list[str]]:
    tutorial = blocks(ROOT / "docs" / "tutorial.md")
    return [without_folder(words) for language, text in tutorial for words in commands(text)]


def commands(text: str) -> list[list[str]]:
    lines = text.replace("\\\n", " ").splitlines()
    return [
        shlex.split(line, comments=True)[1:] for line in lines if line.startswith("eventsweep ")
    ]


def code(page: Path) -> list[str]:
    """What runs: Python, and our commands."""
    return [text for language, text in blocks(page) if language == "python" or commands(text)]


CODE = {page.name: page for page in PAGES if code(page)}
# Five to fifteen seconds each; what they call has tests of its own.
LONG = {
    "api.md", "install.md", "baselines.md", "howto_model.md", "mapper.md", "suite.md",
    "simulator.md",
}  # fmt: skip
ECHO = re.compile(r"^echo '([^']*)' > (\S+)$", re.MULTILINE)
"""A small file that a block writes for its commands."""


@pytest.mark.parametrize("page", often_named(CODE.keys() - LONG, CODE))
def test_code_runs(page, sequences, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # What a page registers must not be known to the tests after it.
    methods.load(ours=True)
    monkeypatch.setattr(methods, "_registered", dict(methods._registered))
    names: dict[str, object] = {}
    for language, text in blocks(page):
        if language == "python":
            exec(compile(text, page.name, "exec"), names)
        for words, name in ECHO.findall(text) if language == "sh" else ():
            Path(name).write_text(words, encoding="utf-8")
        for arguments in commands(text) if language == "sh" else ():
            if page.name == "README.md" and without_folder(arguments) in run_by_the_tutorial():
                continue  # the whole main job once more
            assert performed(arguments) == 0, arguments


def performed(arguments: list[str]) -> int:
    """Runs a command; the long job is cut."""
    if arguments[0] == "run" and "--seconds" not in arguments:
        return main([*arguments, "--seconds", "0.1"])
    return main(arguments)


@pytest.fixture(scope="module")
def sequences(tmp_path_factory):
    """Simulates as asked, by command or from Python; what another page has simulated is copied.

    Sensors have a quarter of their pixels: what is asked is whether the code of a page runs.
    """
    made: dict[tuple[str, ...], Path] = {}

    def shared(scene: Scene, rig: Rig, config: SimConfig, seed: int, out: Path, **how: Any) -> None:
        key = scene.name, str(rig.to_json()), config.model_dump_json(), str(seed)
        if key not in made:
            made[key] = tmp_path_factory.mktemp("simulated") / "sequence"
            simulate(scene, smaller(rig, 2), config, seed, made[key], **how)
        shutil.copytree(made[key], out)

    with pytest.MonkeyPatch.context() as patch:
        # This one first: it imports the other's original, and gets it back.
        patch.setattr("eventsweep.simulation.simulate_to_disk", shared)
        patch.setattr("eventsweep.sim.simulate.simulate", shared)
        yield


def test_the_tutorial_has_code_and_links_lead_somewhere():
    pages = {*PAGES, *ROOT.glob("*.md")}
    texts = {page: BLOCK.sub("", page.read_text(encoding="utf-8")) for page in pages}
    links = [(page, target) for page, text in texts.items() for target in LINK.findall(text)]
    local = [(page, target) for page, target in links if not target.startswith("http")]
    assert len(local) > 200
    if not HAS_PLUGINS:
        local = [(page, target) for page, target in local if "plugins/" not in target]
    dead = [(page.name, target) for page, target in local if not (page.parent / target).exists()]
    assert dead == []
    languages = {language for language, _ in blocks(ROOT / "docs" / "tutorial.md")}
    assert {"sh", "python"} <= languages


def test_commands_of_the_tutorial_read_all_that_its_settings_say(tmp_path, monkeypatch):
    """Every table of a file that a page writes is one that the command with --config reads."""
    monkeypatch.chdir(tmp_path)
    compared = 0
    for page in PAGES:
        pieces = blocks(page)
        files = {
            name: tomllib.loads(text)
            for language, code in pieces
            if language == "python"
            for name, text in re.findall(
                r'Path\("(\w+\.toml)"\)\.write_text\("""(.*?)"""', code, re.DOTALL
            )
        }
        for language, text in pieces:
            for arguments in commands(text) if language == "sh" else ():
                if "--config" in arguments:
                    file = arguments[arguments.index("--config") + 1]
                    reads = READS[arguments[0]]
                    assert set(files.get(file, ())) <= reads, (page.name, arguments)
                    compared += file in files
    assert compared


def test_examples_import_only_public_names():
    inside = re.compile(
        r"^ *(?:from|import) (?:eventsweep\.)?(?:emvs|sim|eval|scenes|plugins)\b.*", re.M
    )
    code = re.compile(r"^ *```python\n(.*?)^ *```", re.M | re.S)
    texts = {page.name: page.read_text(encoding="utf-8") for page in PAGES}
    assert [
        (name, line)
        for name, text in texts.items()
        for block in code.findall(text)
        for line in inside.findall(block)
    ] == []

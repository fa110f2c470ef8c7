"""Whatever names a file, and wherever that lies: no output removes or changes it."""

import os
from collections import Counter
from contextlib import chdir, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import also_read, command
from eventsweep.emvs.utils.output_manifest import complete
from eventsweep.emvs.utils.outputs import (
    atomic_dir,
    claimed,
    discard,
    files_together,
    output_file,
    output_folder,
    replace_dir,
)
from eventsweep.sim.mjcf import SUFFIXES  # and by this import models are known

# Files that name another, {}; PLACE is its folder and NAME the rest.
NAMING = {
    "config.toml": '[map.learned]\nweights = "{}"',
    "preset.toml": '[sim.sensor]\npreset = "{}"',
    "recording.toml": '[[cameras]]\nevents = "{}"',
    "fusion.toml": '[map]\nfusion = "{}:function"',
    "suite.toml": '[cases.one]\nscene = "{}"\n[predictions]\nmine = "{}"',
    "list.toml": 'predictions = ["mine={}"]',
    "texture.xml": '<mujoco><asset><texture file="{}"/></asset></mujoco>',
    "include.xml": '<mujoco><include file="{}"/></mujoco>',
    "mesh.xml": '<mujoco><compiler meshdir="PLACE"/><asset><mesh file="NAME"/></asset></mujoco>',
    f"robot{SUFFIXES[1]}": '<robot name="r"><mesh filename="{}"/></robot>',
}
PLACES = ("", "out", "out/deep", "other", "other/deep")
OUTPUTS = ("out", "./out", "other/../out", "link", "out/deep", "out/new", "other")


def put_chain(draw):
    """Files that name each other, each with its own content; the first one is returned."""
    kinds = draw(st.lists(st.sampled_from(list(NAMING)), max_size=3, unique=True))
    is_folder = not (kinds and "toml" not in kinds[-1]) and draw(st.booleans())
    named = Path.cwd() / draw(st.sampled_from(PLACES)) / "leaf"
    (named if is_folder else named.parent).mkdir(parents=True, exist_ok=True)
    (named / "a" if is_folder else named).write_text("leaf")
    for kind in reversed(kinds):
        file = Path.cwd() / draw(st.sampled_from(PLACES)) / kind
        file.parent.mkdir(parents=True, exist_ok=True)
        own, here = os.path.relpath(named, file.parent), os.path.relpath(named)
        said = draw(st.sampled_from([str(named), own, *([here] if "toml" in kind else [])]))
        place, name = os.path.split(said)
        text = NAMING[kind].replace("{}", said).replace("NAME", name)
        file.write_text(text.replace("PLACE", place or "."))
        named = file
    return named


def given_as(draw, path):
    """How a command or a caller holds the path."""
    path = draw(st.sampled_from([path, Path(os.path.relpath(path))]))
    ways = [path, {"map": [path]}, f"mine={path}", *([str(path)] if path.is_file() else [])]
    return draw(st.sampled_from(ways))


def write(how, out, inputs):
    """Writes an output in one of the ways that commands have."""
    if how == "folder":
        with atomic_dir(out, force=True, inputs=inputs) as made:
            (made / "leaf").write_text("new")
    elif how == "file":
        with output_file(out, force=True, inputs=inputs) as made:
            made.write_text("new")
    elif how == "grown beside":
        with claimed(out) as work:
            (made := out.with_name("grown")).mkdir()
            replace_dir(made, out, work, inputs=inputs)
    elif how == "files":
        names = ("leaf", "leaf/a", "config.toml", "mesh.xml")[:: 1 if out.is_dir() else 2]
        names = [
            name for name in names if name != ("leaf/a" if (out / "leaf").is_file() else "leaf")
        ]
        with output_folder(out, names, force=True), files_together(out, names) as staged:
            for name in names:
                (staged / name).write_text("new")
    else:
        discard(out)


def contents():
    """How often each content is there, whatever its file is called."""
    files = (path for path in Path.cwd().rglob("*") if path.is_file() and not path.is_symlink())
    return Counter(path.read_bytes() for path in files if not path.name.startswith(".eventsweep"))


def one_relation(data):
    """Files that name each other, an output somewhere, and nothing named is lost."""
    draw = data.draw
    with TemporaryDirectory() as root, chdir(root), command():
        Path("link").symlink_to("out")
        first = put_chain(draw)
        for folder in ("out", "other"):  # all of it is ours: nothing else protects it
            Path(folder).mkdir(exist_ok=True)
            complete(Path(folder))
        before, named = contents(), given_as(draw, first)
        how = draw(st.sampled_from(["folder", "file", "grown beside", "files", "discard"]))
        told = how in ("files", "discard") or draw(st.booleans())
        if told:
            also_read({"given": named})
        target = draw(st.sampled_from([*OUTPUTS, os.path.relpath(first)]))
        with suppress(InputError):
            write(how, Path(target), () if told else (named,))
        assert not before - contents()


@pytest.mark.parametrize("count", [50, pytest.param(2000, marks=pytest.mark.slow)])
def test_no_output_removes_or_changes_what_anything_names(count):
    settings(max_examples=count)(given(data=st.data())(one_relation))()

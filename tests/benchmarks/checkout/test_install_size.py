"""What an environment weighs, on environments that one can see through."""

import platform
from importlib import metadata

import pytest

from eventsweep.emvs.errors import InputError
from install_page import Trial, read_size, size_block
from install_size import Weighed, imported, lines, named_modules, normal, weigh


def weighed(name, size_bytes=1, files=(), modules=(), requires=()):
    return Weighed(name, size_bytes, *map(frozenset, (files, modules, requires)))


def test_a_distribution_weighs_what_its_files_do(tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "__init__.py").write_bytes(b"#" * 1000)
    info = tmp_path / "One_Two-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: One_Two\nVersion: 1.0\n"
        "Requires-Dist: Other.One>=1; python_version >= '3'\nRequires-Dist: more; extra == 'x'\n"
    )
    (info / "RECORD").write_text("one/__init__.py,,\none/gone.py,,\n")
    (one,) = map(weigh, metadata.distributions(path=[str(tmp_path)]))
    assert (one.name, one.size_bytes, one.requires) == ("one-two", 1000, {"other-one"})
    assert one.modules == {"one"}
    assert normal("A.b__C") == "a-b-c"


def test_imports_are_found_wherever_they_are(tmp_path):
    code = (
        "import a.b\nfrom . import own\n"
        "def f():\n    from c import d\n    importlib.import_module('e.f')\n"
    )
    (tmp_path / "x.py").write_text(code)
    assert named_modules([tmp_path / "x.py"]) == {"a.b", "c", "c.d", "e.f"}


def test_what_nothing_imports_is_told_from_what_is_imported_later(tmp_path):
    (tmp_path / "used.py").write_text("def f():\n    import later\n")
    (tmp_path / "later.py").write_text("import last\n")
    used, later = str(tmp_path / "used.py"), str(tmp_path / "later.py")
    packages = [
        weighed("used", files=[used], modules=["used"], requires=["later", "web"]),
        weighed("later", files=[later], modules=["later"], requires=["last"]),
        weighed("last", modules=["last"]),
        weighed("web", 30_000_000, modules=["web"]),
        weighed("stray", modules=["stray"]),
    ]
    how = imported(packages, {used})
    assert how == {
        "used": "at once", "later": "by used, on demand", "last": "by later, on demand",
        "web": "never", "stray": "never",
    }  # fmt: skip
    table = list(lines(packages, how, brief=True))
    assert table[2:] == ["| web | 30.0 | never | used |", "| stray | 0.0 | never |  |"]


def test_a_page_keeps_what_other_machines_wrote():
    system = f"{platform.system()} {platform.machine()}"
    others = [
        "| 3.14.2 | Other arm64 | – | 40 | 900 | 0 |",
        f"| 3.12.1 | {system} | – | 9 | 9 | 9 |",
    ]
    first = size_block(Trial("3.11.7", "", 44, 1084, 0), "\n".join(others))
    again = size_block(Trial("3.11.9", "", 45, 1085, 0), first)
    assert f"| 3.11.9 | {system} | – | 45 | 1085 | 0 |" in again
    assert "3.11.7" not in again
    assert all(one in again for one in others)


def test_what_the_size_prints_is_what_the_page_reads():
    printed = "...\nPython 3.11.7: 44 distributions, 1084 MB; never imported: 2, 35 MB\n"
    assert read_size(printed) == ("3.11.7", 44, 1084, 2)
    with pytest.raises(InputError, match="no sum"):
        read_size("Traceback")

"""Help: `--help` shows the flags that matter, `--help-all` all of them; defaults that read well."""

from __future__ import annotations

import ast
import difflib
import inspect
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, Literal

from cyclopts import App, Parameter
from cyclopts.argument import Argument, ArgumentCollection
from cyclopts.exceptions import CycloptsError, UnknownOptionError

from eventsweep.emvs.utils import inputs
from eventsweep.eval.cli import flag_names
from eventsweep.eval.cli.addresses import with_addresses

Shown = Literal["as declared", "nothing", "short", "all"]

ALL = "--help-all"
HELP_FLAGS = ("--help", "-h", ALL)
RARE = Parameter(show=False)
"""Hides an advanced flag: only `--help-all` shows it."""

# Of several hundred settings, all of them rare, those that a first map is likely to need.
_COMMON_SETTINGS = frozenset({
    "--rate-hz", "--slow-motion", "--unit", "--encoding", "--upsample", "--sim.sensor.preset",
    "--map.min-depth-m", "--map.max-depth-m", "--map.planes", "--map.window-s",
    "--score.ranking-metric", "--align", "--associate", "--max-difference-s", "--offset-s",
})  # fmt: skip
# And of the few without a table's prefix, those that hardly anybody needs.
_RARE_SETTINGS = frozenset({"--delay-s", "--map-events", "--maps"})
_CLOSE = 0.7
_OURS = "eventsweep."

_shown: ContextVar[Shown] = ContextVar("shown", default="as declared")
_asked: ContextVar[Shown] = ContextVar("asked", default="short")


class Program(App):
    """The command line. Its help leaves out what few users need, and says how to see it."""

    hidden_flags = 0
    """How many flags the last help of this verb left out."""
    _described: tuple[Shown, ArgumentCollection] | None = None

    def __call__(self, tokens: Any = None, **options: Any) -> Any:
        """Interprets and runs a command, given as words; by default the process's own."""
        words = sys.argv[1:] if tokens is None else list(tokens)
        flags = words[: words.index("--")] if "--" in words else words
        # Nothing is parsed where help is asked for, and a verb's flags take a third of a second.
        needed: Shown = "nothing" if set(flags) & set(HELP_FLAGS) else "as declared"
        asked: Shown = "all" if ALL in flags else "short"
        with inputs.command(), _set(_asked, asked), _set(_shown, needed):
            return super().__call__(words, **options)

    def parse_args(self, *tokens: Any, **options: Any) -> Any:
        """What is called with what; its outputs remove no file that any of it names."""
        flag_names.runs(self._flags_of(tokens))
        command, bound, ignored = super().parse_args(*tokens, **options)
        command = with_addresses(command, bound)
        inputs.also_read(bound.arguments)
        return command, bound, ignored

    def _flags_of(self, tokens: Any) -> Callable[[], ArgumentCollection]:
        """Gives the arguments of the command that the words name; none for an unknown one."""

        def flags() -> ArgumentCollection:
            _, apps, _ = self.parse_commands(tokens[0] if tokens else None)
            if apps[-1].default_command is None:  # no verb, or an unknown one
                return ArgumentCollection()  # type: ignore[no-untyped-call]
            return apps[-1].assemble_argument_collection()

        return flags

    def help_print(
        self,
        tokens: Annotated[Any, Parameter(show=False)] = None,
        *,
        console: Annotated[Any, Parameter(parse=False)] = None,
    ) -> None:
        """Prints the help of the program or of one verb."""
        words = [] if tokens is None else list(tokens)
        with _set(_shown, _asked.get()):
            super().help_print(words, console=console)
            chain, apps, _ = self.parse_commands(words)
        if hidden := getattr(apps[-1], "hidden_flags", 0):
            where = " ".join((self.name[0], *chain, ALL))
            sys.stdout.write(f"{hidden} more flags: {where}\n")

    def assemble_argument_collection(self, **options: Any) -> ArgumentCollection:
        """What a verb takes, and while help is printed, what of it is shown."""
        shown = _shown.get()
        if shown == "nothing":
            return ArgumentCollection()  # type: ignore[no-untyped-call]
        if shown == "as declared":
            return super().assemble_argument_collection(**options)
        if self._described is None or self._described[0] != shown:
            # The library reads each class's source and its bases' again and again: a second.
            found = super().assemble_argument_collection()
            texts = _texts_of(found, self.default_command)
            for argument in found:
                _settle(argument, texts, shows_all=shown == "all")
            self.hidden_flags = sum(not (one.show or one.children) for one in found)
            self._described = shown, found
        return self._described[1]

    def generate_completion(self, **options: Any) -> str:
        """A shell's completion script, which knows all flags."""
        with _set(_shown, "all"):
            return super().generate_completion(**options)


@contextmanager
def _set(variable: ContextVar[Shown], value: Shown) -> Iterator[None]:
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def _texts_of(
    arguments: ArgumentCollection, command: Callable[..., Any] | None
) -> Callable[[Argument], str]:
    """What says what an argument is: its description, or the docstring of command or class."""
    import docstring_parser

    own = docstring_parser.parse((command and command.__doc__) or "").params
    by_name = {param.arg_name: param.description or "" for param in own}
    owners = {id(child): parent.resolved_hint for parent in arguments for child in parent.children}

    def text(argument: Argument) -> str:
        if argument.parameter.help:
            return argument.parameter.help
        name, owner = argument.field_info.name, owners.get(id(argument))
        return by_name.get(name, "") if owner is None else _attribute_text(owner, name)

    return text


def _attribute_text(owner: type, name: str) -> str:
    own = (cls for cls in owner.__mro__ if cls.__module__.startswith(_OURS))
    texts = (_attribute_texts(cls.__module__).get((cls.__name__, name), "") for cls in own)
    return next(filter(None, texts), "")


@cache
def _attribute_texts(module: str) -> dict[tuple[str, str], str]:
    """The docstrings of attributes, by class and attribute."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {
        (node.name, ast.unparse(field.target)): text.value.value
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        for field, text in pairwise(node.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def _settle(argument: Argument, text_of: Callable[[Argument], str], *, shows_all: bool) -> None:
    wanted = argument.parameter.show
    if shows_all or argument.name in _COMMON_SETTINGS:
        wanted = True
    elif argument.name in _RARE_SETTINGS:
        argument.parameter = Parameter.combine(argument.parameter, RARE)
        return
    if wanted is not False:
        own = Parameter(show=wanted, help=_sentence(text_of(argument)))
        argument.parameter = Parameter.combine(argument.parameter, own)


def _sentence(text: str) -> str:
    """A field's description as a sentence; what begins with a value's name keeps its letters."""
    text = " ".join(text.split())
    first = text.partition(" ")[0]
    if not first.endswith(":") and "_" not in first and "`" not in first:
        text = text[:1].upper() + text[1:]
    return text if not text or text.endswith((".", "?", "!")) else f"{text}."


def readable(value: Any) -> str | None:
    """A default as help shows it; None where there is nothing to show."""
    if value is None or value is False or value in ("", ()):
        return None
    if value is True:
        return "on"
    if isinstance(value, tuple | list):
        return ", ".join(part for part in map(readable, value) if part is not None)
    return f"{value:g}" if isinstance(value, float) else str(value)


def refusal(error: CycloptsError, program: str) -> str:
    """What is wrong with a command, in one line, and where its verb's help is."""
    verb = " ".join(error.command_chain or ())
    chain = f"{program} {verb}".strip()
    if isinstance(error, UnknownOptionError):
        flag = error.token.keyword or error.token.value
        suggestion = _suggestion(flag, error.argument_collection)
        text = f"{verb or program} takes no flag {flag}{suggestion}"
    else:
        text = " ".join(str(error).split())
    return f"{text} (`{chain} --help` shows what there is)"


def _suggestion(flag: str, arguments: Iterable[Argument]) -> str:
    single = (argument for argument in arguments if argument.parse and not argument.children)
    known = [name for argument in single for name in argument.names if name.startswith("--")]
    nearest = _nearest(flag, known)
    return f"; did you mean {nearest}?" if nearest else ""


def _nearest(flag: str, names: list[str]) -> str:
    """The name most like a flag, with its table's prefix or without; empty where none is."""

    def likeness(name: str) -> float:
        forms = (name.removeprefix("--"), name.removeprefix("--").rpartition(".")[2])
        asked = flag.removeprefix("--")
        return max(difflib.SequenceMatcher(None, asked, form).ratio() for form in forms)

    best = max(names, key=likeness, default="")
    return best if best and likeness(best) >= _CLOSE else ""

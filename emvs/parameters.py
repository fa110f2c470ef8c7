"""What all groups of parameters are: unknown names and bad values are refused, in one line."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eventsweep.emvs.errors import InputError, offer, quoted, shown

RUNS_CODE = "runs code"
"""Marks, in `Annotated`, a field that names code to run: a flag or a call may set it, no file."""


TimeUs = Annotated[int, Field(ge=-(1 << 61), le=1 << 61)]
"""A time or a difference of two, µs: a file's whole numbers may have more than 64 bits."""


class FrozenModel(BaseModel):
    """Named values: nothing unknown is taken, and nothing changes afterwards."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ParameterGroup(FrozenModel):
    """A group of parameters.

    Raises:
        InputError: an unknown name or an impossible value.
    """

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise fault(error, type(self)) from None

    # So marked, it is not called for groups within groups: their faults keep their whole names.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    if not TYPE_CHECKING:  # a type checker knows without it that nothing may be assigned

        def __setattr__(self, name: str, value: object) -> None:
            raise InputError(
                f"{type(self).__name__} cannot be changed: make another one with {name}={value!r}"
            )

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """What `repr` shows: only what is not as it is by default."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if value != field.get_default(call_default_factory=True):
                yield name, value

    @classmethod
    def model_validate(cls, obj: Any, **options: Any) -> Self:
        """Takes plain values, such as a table of a file."""
        try:
            return super().model_validate(obj, **options)
        except ValidationError as error:
            raise fault(error, cls) from None

    @classmethod
    def or_default(cls, given: Self | None) -> Self:
        """What a caller gave, or all defaults for None.

        Raises:
            InputError: something else than this group.
        """
        if given is None:
            return cls()
        if not isinstance(given, cls):
            raise InputError(f"configuration {shown(given)}: needs {cls.__name__}(...)")
        return given


def fault(
    error: ValidationError, model: type[BaseModel], where: str = "", above: str = ""
) -> InputError:
    """The first fault of a pydantic error in one line, with the parameter that it is of.

    Args:
        error: what was raised.
        model: what was made.
        where: what the line begins with, such as a file's name and a colon.
        above: the groups that the model lies in, each with a dot.
    """
    first = error.errors(include_url=False, include_context=False)[0]
    place, value = first["loc"], shown(first["input"])
    key = above + ".".join(map(quoted, place)) if place else model.__name__
    if first["type"] == "extra_forbidden":
        return InputError(f"{where}unknown key {key}{_suggestion(model, place)}")
    message = first["msg"].removeprefix("Value error, ")
    kind = _annotation(model, place)
    if first["type"] == "value_error" and (kind is None or hasattr(kind, "model_fields")):
        return InputError(f"{where}{message}")
    more = f" ({error.error_count() - 1} more faults)" if error.error_count() > 1 else ""
    line = f"{where}{key} is {value}: {message[0].lower()}{message[1:]}{more}"
    return InputError(line, parameter="" if where else key)


def refuse_code(model: type[BaseModel], values: Any, where: str = "", above: str = "") -> None:
    """Refuses a file's values that name code to run: with them, a stranger's settings would run it.

    Args:
        model: what the values are of.
        values: plain ones, as the file holds them.
        where: what to begin with, such as a file's name and a colon.
        above: the groups that the model lies in, each with a dot.

    Raises:
        InputError: names the first of them.
    """
    for name, value in values.items() if isinstance(values, dict) else ():
        field, key = model.model_fields.get(name), f"{above}{name}"
        if field is None:
            continue
        if RUNS_CODE in field.metadata and value:
            raise InputError(
                f"{where}{key} is {shown(value)}: no file may name code to run; leave it out, and "
                f"give --{key} on the command line"
            )
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            refuse_code(field.annotation, value, where, f"{key}.")


def first_fault(error: ValidationError) -> str:
    """Where a pydantic error's first fault is, and what it is: for files that are no parameters."""
    fault = error.errors()[0]
    return f"{'.'.join(map(quoted, fault['loc']))}: {fault['msg']}".removeprefix(": ")


def _suggestion(model: type[BaseModel], place: tuple[int | str, ...]) -> str:
    known = list(getattr(_annotation(model, place[:-1]), "model_fields", ()))
    if not known:  # such as an entry of a list: what it may hold is not looked up
        return ""
    close = difflib.get_close_matches(str(place[-1]), known, n=1)
    return f"; did you mean {close[0]}?" if close else f"; {offer(sorted(known), 'leave it out')}"


def _annotation(model: type[BaseModel], place: tuple[int | str, ...]) -> Any:
    """What a place in a model is to hold; None where no group has such a field."""
    kind: Any = model
    for name in place:
        field = getattr(kind, "model_fields", {}).get(str(name))
        kind = field.annotation if field else None
    return kind


def stated(settings: BaseModel) -> dict[str, Any]:
    """What makes the same settings again, as plain JSON values: what was set, and what that set."""
    own = settings.model_dump(mode="json", exclude_unset=True)
    again = type(settings).model_validate(own).model_dump(mode="json")
    whole = settings.model_dump(mode="json")
    return own | {name: value for name, value in whole.items() if again[name] != value}

"""A seated reader made of primitives: head with hair, body, arms, and a book in both hands."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eventsweep.scenes.parts.furniture import BodyBuilder, Point

if TYPE_CHECKING:
    import mujoco


def reader(spec: mujoco.MjSpec, name: str, at_m: Point, yaw_deg: float = 0) -> None:
    """Seats a person who faces -y on a chair at `at_m` and reads a book on a table before it.

    Args:
        spec: edited in place; needs the materials of stock.xml, `skin`, `hair`, `shirt`, `jeans`.
        name: prefix of the geoms' names.
        at_m: on the floor, under the hips, m.
        yaw_deg: turns the whole person about z.
    """
    group = BodyBuilder(spec, name, at_m, yaw_deg)
    _trunk(group)
    _head(group)
    for side in (-1.0, 1.0):
        _limbs(group, side)
    _book(group)


def _trunk(group: BodyBuilder) -> None:
    group.ball((0.18, 0.13, 0.13), (0, 0.0, 0.56), "jeans")
    group.ball((0.165, 0.115, 0.2), (0, -0.01, 0.76), "shirt", (6, 0, 0))
    group.ball((0.2, 0.12, 0.17), (0, -0.05, 0.96), "shirt", (10, 0, 0))
    group.rod((-0.15, -0.06, 1.05), (0.15, -0.06, 1.05), 0.06, "shirt")


def _head(group: BodyBuilder) -> None:
    """A head bent over the book."""
    group.rod((0, -0.06, 1.08), (0, -0.1, 1.18), 0.05, "skin")
    group.ball((0.078, 0.1, 0.115), (0, -0.14, 1.26), "skin", (22, 0, 0))
    group.ball((0.09, 0.1, 0.085), (0, -0.112, 1.318), "hair", (22, 0, 0))
    group.ball((0.088, 0.07, 0.1), (0, -0.08, 1.28), "hair", (22, 0, 0))
    group.ball((0.014, 0.02, 0.022), (0, -0.245, 1.235), "skin", (22, 0, 0))
    for side in (-1.0, 1.0):
        group.ball((0.012, 0.02, 0.03), (0.08 * side, -0.13, 1.25), "skin")
        group.ball((0.012, 0.006, 0.007), (0.034 * side, -0.228, 1.262), "ink", (22, 0, 0))
        group.rod((0.018 * side, -0.232, 1.282), (0.05 * side, -0.226, 1.282), 0.004, "hair")


def _limbs(group: BodyBuilder, side: float) -> None:
    shoulder, elbow = (0.2 * side, -0.06, 1.03), (0.27 * side, -0.24, 0.81)
    hand = (0.15 * side, -0.44, 0.89)
    group.rod(shoulder, elbow, 0.05, "shirt")
    group.rod(elbow, hand, 0.038, "shirt")
    group.ball((0.035, 0.055, 0.028), (0.14 * side, -0.47, 0.91), "skin", (30, 0, 20 * side))
    knee, foot = (0.12 * side, -0.42, 0.52), (0.12 * side, -0.4, 0.08)
    group.rod((0.1 * side, 0, 0.52), knee, 0.075, "jeans")
    group.rod(knee, foot, 0.055, "jeans")
    group.ball((0.045, 0.12, 0.04), (0.12 * side, -0.46, 0.04), "dark")


def _book(group: BodyBuilder) -> None:
    """An open book, held up at an angle, its cover to whoever looks at the reader."""
    for side in (-1.0, 1.0):
        group.box((0.088, 0.006, 0.12), (0.085 * side, -0.5, 0.97), "cover", (28, 0, 9 * side))
        group.box((0.084, 0.004, 0.115), (0.083 * side, -0.49, 0.975), "page_a", (28, 0, 9 * side))
    group.box((0.01, 0.005, 0.12), (0, -0.514, 0.968), "cover", (28, 0, 0))

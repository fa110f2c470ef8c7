"""Slow, plain twins of the event formats' kernels: one word, one event, one line at a time."""

from fractions import Fraction

import numpy as np

from eventsweep.emvs.data.events import Events


def events_of(rows):
    """Events from rows of (t_us, x, y, p)."""
    t_us, x, y, p = (list(column) for column in zip(*rows, strict=True)) if rows else ([],) * 4
    kinds = np.uint16, np.uint16, np.int64, np.uint8
    return Events(*(np.array(c, k) for c, k in zip((x, y, t_us, p), kinds, strict=True)))


def rows_of(events):
    """Rows of (t_us, x, y, p) from events."""
    columns = (events.t_us, events.x, events.y, events.p)
    return list(zip(*(column.tolist() for column in columns), strict=True))


class Counter:
    """A counter of so many bits that wraps where it falls by half its range or more."""

    def __init__(self, bits):
        self.bits, self.loops, self.value = bits, 0, None

    def take(self, value):
        if self.value is not None and self.value - value >= 2 ** (self.bits - 1):
            self.loops += 1
        self.value = value

    @property
    def whole(self):
        return self.loops * 2**self.bits + self.value


def decode_evt2(words):
    rows, high = [], Counter(28)
    for word in map(int, words):
        kind = word >> 28
        if kind == 8:
            high.take(word % 2**28)
        elif kind in (0, 1) and high.value is not None:
            t_us = high.whole * 64 + word // 2**22 % 64
            rows.append((t_us, word // 2**11 % 2048, word % 2048, kind))
    return rows


def decode_evt21(words):
    rows, high = [], Counter(28)
    for word in map(int, words):
        kind = word >> 60
        if kind == 8:
            high.take(word >> 32 & (2**28 - 1))
        elif kind in (0, 1) and high.value is not None:
            t_us = high.whole * 64 + (word >> 54) % 64
            x, y = (word >> 43) % 2048, (word >> 32) % 2048
            rows += [(t_us, x + bit, y, kind) for bit in range(32) if word >> bit & 1]
    return rows


def decode_evt3(words):
    rows, high = [], Counter(12)
    low = y = base_x = polarity = 0
    for word in map(int, words):
        kind, value = word >> 12, word % 4096
        t_us = None if high.value is None else high.whole * 4096 + low
        match kind:
            case 0:
                y = value % 2048
            case 2 if t_us is not None:
                rows.append((t_us, value % 2048, y, value >> 11))
            case 3:
                base_x, polarity = value % 2048, value >> 11
            case 4 | 5:
                width = 12 if kind == 4 else 8
                bits = [bit for bit in range(width) if value >> bit & 1]
                rows += [(t_us, base_x + b, y, polarity) for b in bits if t_us is not None]
                base_x += width
            case 6:
                low = value
            case 8:
                if value != high.value:
                    low = 0
                high.take(value)
    return rows


def decode_dat(words):
    rows, low = [], Counter(32)
    for word in map(int, words):
        low.take(word % 2**32)
        place = word >> 32
        rows.append((low.whole, place % 2**14, place // 2**14 % 2**14, place >> 28))
    return rows


def decode_aedat2(data, size_px):
    """Big-endian words of an address and a time, the pixel counted from below and the right."""
    rows, clock, (width, height) = [], Counter(32), size_px
    for at in range(0, len(data), 8):
        address = int.from_bytes(data[at : at + 4], "big")
        clock.take(int.from_bytes(data[at + 4 : at + 8], "big"))
        bits = f"{address:032b}"
        if size_px == (128, 128) and bits[:17] == "0" * 17:
            x, y, p = int(bits[24:31], 2), int(bits[17:24], 2), bits[31] == "0"
        elif size_px != (128, 128) and bits[0] == "0" and bits[21] == "0":
            x, y, p = int(bits[10:20], 2), int(bits[1:10], 2), bits[20] == "1"
        else:
            continue
        rows.append((clock.whole, width - 1 - x, height - 1 - y, int(p)))
    return rows


def decode_aedat3(data):
    """Packets one after another, their events one after another."""
    rows, at = [], 0

    def take(size):
        nonlocal at
        at += size
        return int.from_bytes(data[at - size : at], "little")

    while at < len(data):
        kind, _, size, _, overflow, _, count, _ = (take(n) for n in (2, 2, 4, 4, 4, 4, 4, 4))
        for _ in range(count):
            word, stamp = (take(4), take(4)) if kind == 1 else (0, 0)
            at += 0 if kind == 1 else size
            if word % 2:
                t_us = overflow * 2**31 + stamp
                rows.append((t_us, word // 2**17, word // 4 % 2**15, word // 2 % 2))
    return rows


def decode_ros(data, count, ros2):
    """Field by field; ROS2 aligns each to its own size."""
    rows, at = [], 0

    def take(size):
        nonlocal at
        at += -at % size if ros2 else 0
        at += size
        return int.from_bytes(bytes(data[at - size : at]), "little")

    for _ in range(count):
        x, y, seconds, nanoseconds, p = take(2), take(2), take(4), take(4), take(1)
        rows.append((seconds * 10**6 + (nanoseconds + 500) // 1000, x, y, p))
    return rows


def parse_text(text, power):
    """Lines `t x y p`; a time counts 10**power µs and is rounded half up."""
    rows = []
    for line in text.splitlines():
        if line.strip() and not line.strip().startswith("#"):
            t, x, y, p = line.replace(",", " ").split()
            t_us = Fraction(t) * Fraction(10) ** power
            rows.append((int(t_us + Fraction(1, 2)), int(x), int(y), int(float(p) > 0)))
    return rows


def convert_rows(rows):
    """Rows of doubles up to the first that is no event."""
    out = []
    for x, y, t_s, p in rows:
        whole = all(0 <= value <= 65535 and value % 1 == 0 for value in (x, y))
        if not whole or not 0 <= t_s * 1e6 < 2.0**62 or p not in (1, 0, -1):
            break
        out.append((round(t_s * 1e6), int(x), int(y), int(p > 0)))
    return out

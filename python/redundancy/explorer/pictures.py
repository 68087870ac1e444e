"""Small drawings for the panels, as SVG: bands of a self-motion, margins, strips and the map along a path."""

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from redundancy.explorer.arm import Array

# Colours that colour-blind readers tell apart [Okabe, Ito]; each has a contrast of 3 or more with white.
BLUE, ORANGE, VERMILION, GREEN, GREY, INK = "#0072b2", "#b36b00", "#c04a00", "#007d5c", "#b9bec4", "#24292f"
LIGHT = "#e6e8eb"
RAMP = ("#2b1a5e", "#2a4d9b", "#1f83a8", "#35a87a", "#a3b83a", "#f0b000")
"""Colours of values from low to high: their lightness grows, so that they can be told apart without hues."""

WIDTH = 340
"""Width of a drawing, pixels."""
LABEL = 64
"""Room for labels at its left."""
TEXT = "font-family:system-ui,sans-serif;font-size:11px"
NEAR_LIMIT = 0.1
"""Share of half a joint's range below which its margin is drawn as near the limit."""

NOTHING = 1e-3
"""Share of the range of a drawing below which a label is 0."""
FULL = 0.999
"""Share of a limit from which it is drawn as reached."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Three bytes of a colour such as `#0072b2`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def margin_colour(share: float) -> str:
    """Colour of a joint by its margin as a share of half its range."""
    return VERMILION if share < 0.0 else ORANGE if share < NEAR_LIMIT else BLUE


def figure(width: float, height: float, parts: Sequence[str], title: str) -> str:
    """An SVG element with a title that screen readers read."""
    return (
        f'<svg role="img" aria-label="{escape(title, quote=True)}" viewBox="-2 0 {width + 14:g} {height:g}" '
        f'style="width:100%;display:block;margin:4px 0;background:#fff">{"".join(parts)}</svg>'
    )


def text(
    x: float, y: float, words: str, anchor: str = "start", colour: str = INK, weight: str = "400"
) -> str:
    """A line of text."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}" '
        f'style="{TEXT};font-weight:{weight}">{escape(words)}</text>'
    )


def rect(x: float, y: float, width: float, height: float, colour: str) -> str:
    """A filled rectangle; never thinner than half a pixel, or it could not be seen."""
    box = f'x="{x:.2f}" y="{y:.2f}" width="{max(width, 0.5):.2f}" height="{height:.2f}"'
    return f'<rect {box} fill="{colour}" shape-rendering="crispEdges"/>'


def ramp(values: Array, low: float, high: float) -> NDArray[np.uint8]:
    """Colours `(N, 3)` of values: from dark blue for `low` to amber for `high`, ever lighter on the way."""
    share = np.clip((np.asarray(values, dtype=float) - low) / max(high - low, 1e-300), 0.0, 1.0)
    stops = np.array([rgb(colour) for colour in RAMP], dtype=float)
    at = np.linspace(0.0, 1.0, len(stops))
    out = np.column_stack([np.interp(share, at, stops[:, k]) for k in range(3)])
    colours: NDArray[np.uint8] = np.rint(out).astype(np.uint8)
    return colours


def colour_bar(title: str, low: float, high: float) -> str:
    """What the colours of `ramp` mean."""
    top, inner, steps = 18.0, 14.0, 64
    left, room = 6.0, WIDTH - 12.0
    parts = [text(left, 11, title, weight="600")]
    colours = ramp(np.linspace(0.0, 1.0, steps), 0.0, 1.0)
    for k, (r, g, b) in enumerate(colours):
        parts.append(rect(left + room * k / steps, top, room / steps + 0.5, inner, f"#{r:02x}{g:02x}{b:02x}"))
    y = top + inner + 13
    parts += [text(left, y, f"{low:.3g}"), text(left + room, y, f"{high:.3g}", "end")]
    parts.append(text(left + room / 2, y, f"{0.5 * (low + high):.3g}", "middle"))
    return figure(WIDTH, y + 4, parts, title)


def within_turn(arcs: Array, closed: bool) -> list[tuple[float, float]]:
    """Arcs as parts of [-pi, pi] where the piece is closed; as they are otherwise."""
    parts: list[tuple[float, float]] = []
    for low, high in np.asarray(arcs, dtype=float):
        if not closed:
            parts.append((float(low), float(high)))
        elif high - low >= 2.0 * np.pi:
            parts.append((-np.pi, np.pi))
        else:
            start = float((low + np.pi) % (2.0 * np.pi) - np.pi)
            end = start + float(high - low)
            parts.append((start, min(end, np.pi)))
            if end > np.pi:
                parts.append((-np.pi, end - 2.0 * np.pi))
    return parts


def bands(
    rows: Sequence[tuple[str, Array, tuple[float, float], bool]], chosen: int | None, u: float, unit: str
) -> str:
    """Feasible arcs of every piece, one row each, with a marker on the chosen one.

    Args:
        rows: Per piece its label, its arcs `(k, 2)`, its range, and whether it is closed.
        chosen: Index of the chosen piece.
        u: Parameter on it.
        unit: Words for the axis.
    """
    row, top = 16.0, 4.0
    height = top + row * len(rows) + 18.0
    parts = []
    for index, (label, arcs, (low, high), closed) in enumerate(rows):
        y, span = top + row * index, max(high - low, 1e-12)
        bold = index == chosen
        parts.append(text(LABEL - 8, y + 11, label, "end", INK, "700" if bold else "400"))
        parts.append(rect(LABEL, y + 2, WIDTH - LABEL, 11, LIGHT))
        for first, last in within_turn(arcs, closed):
            x0, x1 = (LABEL + (WIDTH - LABEL) * (v - low) / span for v in (first, last))
            parts.append(rect(x0, y + 2, x1 - x0, 11, BLUE if bold else "#7fb2d6"))
        if bold:
            x = LABEL + (WIDTH - LABEL) * (u - low) / span
            parts.append(f'<path d="M{x:.1f} {y:.1f}v15" stroke="{INK}" stroke-width="5"/>')
            parts.append(f'<path d="M{x:.1f} {y + 1:.1f}v13" stroke="#fff" stroke-width="2"/>')
    y = top + row * len(rows) + 12
    closed_rows = bool(rows) and all(closed for _, _, _, closed in rows)
    ends = ("-180\N{DEGREE SIGN}", "180\N{DEGREE SIGN}") if closed_rows else ("start", "end")
    if len(rows) == 1 and not closed_rows and rows[0][2][0] == -rows[0][2][1]:
        ends = (
            f"{np.degrees(rows[0][2][0]):.0f}\N{DEGREE SIGN}",
            f"{np.degrees(rows[0][2][1]):.0f}\N{DEGREE SIGN}",
        )
    parts += [text(LABEL, y, ends[0]), text(WIDTH, y, ends[1], "end")]
    parts.append(text((LABEL + WIDTH) / 2, y, unit, "middle"))
    return figure(WIDTH, height, parts, "where all joint limits hold along each self-motion")


def margins(names: Sequence[str], values: Array, shares: Array, prismatic: Sequence[bool]) -> str:
    """A bar per joint: where it is between its limits, coloured by its margin."""
    row, label, right = 15.0, 108.0, 62.0
    parts, room = [], WIDTH - label - right
    for j, name in enumerate(names):
        y = 2.0 + row * j
        share, value = float(shares[j]), float(values[j])
        parts.append(text(label - 6, y + 11, name if len(name) <= 17 else "…" + name[-16:], "end"))
        parts.append(rect(label, y + 3, room, 9, LIGHT))
        parts.append(rect(label, y + 3, room * float(np.clip(share, 0.02, 1.0)), 9, margin_colour(share)))
        if np.isfinite(value):
            words = f"{1e3 * value:.0f} mm" if prismatic[j] else f"{np.degrees(value):.1f}\N{DEGREE SIGN}"
        else:
            words = "no limit"
        parts.append(text(label + room + 4, y + 11, words))
    return figure(WIDTH, 4.0 + row * len(names), parts, "distance of each joint from its nearer limit")


def loads(names: Sequence[str], shares: Array) -> str:
    """A bar per joint: how much of a limit it uses, from 0 to 1."""
    row, label, right = 15.0, 108.0, 62.0
    parts, room = [], WIDTH - label - right
    for j, name in enumerate(names):
        y, share = 2.0 + row * j, float(shares[j])
        colour = VERMILION if share >= FULL else BLUE
        parts.append(text(label - 6, y + 11, name if len(name) <= 17 else "…" + name[-16:], "end"))
        parts.append(rect(label, y + 3, room, 9, LIGHT))
        parts.append(rect(label, y + 3, room * float(np.clip(share, 0.0, 1.0)), 9, colour))
        parts.append(text(label + room + 4, y + 11, f"{100.0 * share:.0f} %"))
    return figure(WIDTH, 4.0 + row * len(names), parts, "speed of each joint as a share of its limit")


def clearances(values: dict[str, float], most: float) -> str:
    """A bar per link: its distance from the obstacles."""
    row, label, right = 15.0, 108.0, 62.0
    room, parts = WIDTH - label - right, []
    for k, (name, value) in enumerate(values.items()):
        y = 2.0 + row * k
        colour = VERMILION if value < 0.0 else ORANGE if value < 0.03 else GREEN
        parts.append(text(label - 6, y + 11, name if len(name) <= 17 else "…" + name[-16:], "end"))
        parts.append(rect(label, y + 3, room, 9, LIGHT))
        parts.append(rect(label, y + 3, room * float(np.clip(value / most, 0.02, 1.0)), 9, colour))
        parts.append(text(label + room + 4, y + 11, f"{1e3 * value:.0f} mm"))
    return figure(WIDTH, 4.0 + row * max(len(values), 1), parts, "distance of each link from the obstacles")


def strip(
    title: str,
    x: Array,
    lines: Sequence[tuple[str, Array, str]],
    at: float | None,
    limits: Sequence[float] = (),
    x_label: str = "",
) -> str:
    """Curves over a common axis with a marker; the y range follows the data, limits are drawn where in view.

    Args:
        title: What is drawn, and its unit.
        x: `(N,)`.
        lines: Name, `(N,)` values and colour of each curve.
        at: Where the marker is; None for no marker.
        limits: Levels that must not be passed.
        x_label: Words under the axis.
    """
    left, height, top, bottom = 44.0, 96.0, 18.0, 14.0 if x_label else 4.0
    span = max(float(x[-1] - x[0]), 1e-12)
    values = np.concatenate([v[np.isfinite(v)] for _, v, _ in lines]) if lines else np.zeros(0)
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    pad = 0.08 * (high - low) or max(1e-6, 0.1 * abs(high))
    low, high = low - pad, high + pad
    inner = height - top - bottom

    def px(v: Array | float) -> Array:
        return np.asarray(left + (WIDTH - left - 4) * (np.asarray(v) - x[0]) / span)

    def py(v: Array | float) -> Array:
        return np.asarray(top + inner * (high - np.asarray(v)) / (high - low))

    parts = [text(0, 11, title, weight="600")]
    parts.append(f'<rect x="{left}" y="{top}" width="{WIDTH - left - 4}" height="{inner}" fill="#f6f7f8"/>')
    for level in limits:
        if low <= level <= high:
            y = float(py(level))
            parts.append(
                f'<path d="M{left} {y:.1f}H{WIDTH - 4}" stroke="{VERMILION}" stroke-width="1.5" '
                'stroke-dasharray="5 3"/>'
            )
    for level in (low + pad, high - pad):
        # What is nothing beside the range is 0, not 1e-15.
        rounded = 0.0 if abs(level) < NOTHING * (high - low) else level
        parts.append(text(left - 4, float(py(level)) + 4, f"{rounded:.3g}", "end"))
    for _, v, colour in lines:
        parts.append(polyline(px(x), py(v), colour))
    if at is not None:
        mark = float(px(at))
        parts.append(f'<path d="M{mark:.1f} {top}v{inner}" stroke="{INK}" stroke-width="1.5"/>')
    if len(lines) > 1:
        for k, (name, _, colour) in enumerate(lines):
            parts.append(text(WIDTH - 4 - 70 * (len(lines) - 1 - k), 11, name, "end", colour, "600"))
    if x_label:
        parts.append(text((left + WIDTH) / 2, height - 3, x_label, "middle"))
        parts.append(text(left, height - 3, f"{x[0]:.3g}"))
        parts.append(text(WIDTH - 4, height - 3, f"{x[-1]:.3g}", "end"))
    return figure(WIDTH, height, parts, title)


def polyline(x: Array, y: Array, colour: str, width: float = 1.6) -> str:
    """A curve, broken where a value is not finite."""
    path, pen = [], False
    for one, two in zip(x, y, strict=True):
        if not np.isfinite(two):
            pen = False
            continue
        path.append(f"{'L' if pen else 'M'}{one:.1f} {two:.1f}")
        pen = True
    return f'<path d="{"".join(path)}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def spare_map(
    title: str,
    s: Array,
    columns: Sequence[Sequence[tuple[float, float]]],
    lines: Sequence[tuple[Array, str]],
    at: tuple[float, float] | None,
) -> str:
    """The spare coordinate (rad, one turn high) over the path: what the limits allow, the chosen line, a marker.

    Args:
        title: What is drawn.
        s: `(N,)` lengths along the path, m.
        columns: Per point the allowed parts of [-pi, pi].
        lines: `(N,)` values of each line, rad, and its colour.
        at: Length and value of the marker.
    """
    left, top, inner = 44.0, 18.0, 132.0
    span = max(float(s[-1] - s[0]), 1e-12)
    edges = np.concatenate([[s[0]], 0.5 * (s[1:] + s[:-1]), [s[-1]]])

    def px(v: Array | float) -> Array:
        return np.asarray(left + (WIDTH - left - 4) * (np.asarray(v) - s[0]) / span)

    def py(v: Array | float) -> Array:
        return np.asarray(top + inner * (np.pi - np.asarray(v)) / (2.0 * np.pi))

    parts = [text(0, 11, title, weight="600"), rect(left, top, WIDTH - left - 4, inner, "#d9dce0")]
    for k, column in enumerate(columns):
        x0, x1 = float(px(edges[k])), float(px(edges[k + 1]))
        for low, high in column:
            parts.append(rect(x0, float(py(high)), x1 - x0 + 0.3, float(py(low) - py(high)), "#a8cde6"))
    for values, colour in lines:
        turned = (values + np.pi) % (2.0 * np.pi) - np.pi
        jumps = np.flatnonzero(np.abs(np.diff(turned)) > np.pi) + 1
        parts.append(
            polyline(px(np.insert(s, jumps, s[jumps])), py(np.insert(turned, jumps, np.nan)), colour, 2.2)
        )
    if at is not None:
        x, y = float(px(at[0])), float(py((at[1] + np.pi) % (2.0 * np.pi) - np.pi))
        parts.append(f'<path d="M{x:.1f} {top}v{inner}" stroke="{INK}" stroke-width="1"/>')
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{VERMILION}" stroke="#fff" stroke-width="2"/>'
        )
    for level, words in (
        (np.pi, "180\N{DEGREE SIGN}"),
        (0.0, "0\N{DEGREE SIGN}"),
        (-np.pi, "-180\N{DEGREE SIGN}"),
    ):
        parts.append(text(left - 4, float(py(level)) + 4, words, "end"))
    height = top + inner + 16
    parts.append(text((left + WIDTH) / 2, height - 4, "along the path (m)", "middle"))
    parts += [text(left, height - 4, f"{s[0]:.3g}"), text(WIDTH - 4, height - 4, f"{s[-1]:.3g}", "end")]
    return figure(WIDTH, height, parts, title)


def shown(total: int, most: int) -> NDArray[np.int64]:
    """At most `most` indices of `total`, the first and last among them."""
    return np.unique(np.linspace(0, total - 1, min(total, most)).round().astype(np.int64))

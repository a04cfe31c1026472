"""Small pieces of HTML: numbers, tables, pictures."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from importlib import resources
from typing import Any

import numpy as np

DASH = "–"


def escape(text: Any) -> str:
    """Text that is safe anywhere in the page."""
    return html.escape(str(text), quote=True)


def number(value: float | None, digits: int = 2) -> str:
    """``value`` with ``digits`` decimals, a dash where there is none."""
    if value is None or not np.isfinite(value):
        return DASH
    text = f"{value:.{digits}f}".replace("-", "−")
    return text[1:] if text.startswith("−") and not text.strip("−0.") else text


def percent(value: float | None, digits: int = 0) -> str:
    """A share as a percentage."""
    return DASH if value is None or not np.isfinite(value) else number(100 * value, digits) + " %"


def with_range(value: str, bounds: Sequence[float | None], shown: Any = number, *, best: bool = False) -> str:
    """A value over its interval; ``best`` in bold."""
    top = f'<span class="best">{value}</span>' if best else value
    low, high = (shown(bound) for bound in bounds)
    return top if value == DASH or low == DASH else f'{top}<span class="range">{low} … {high}</span>'


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, text: Sequence[int] = ()) -> str:
    """A table of ready-made cells; columns in ``text`` hold prose."""

    def row(cells: Sequence[str], tag: str) -> str:
        kinds = (' class="text"' if k in text else "" for k in range(len(cells)))
        return "".join(f"<{tag}{kind}>{cell}</{tag}>" for kind, cell in zip(kinds, cells, strict=True))

    body = "\n".join(f"<tr>{row(cells, 'td')}</tr>" for cells in rows)
    heading = f"<thead><tr>{row(head, 'th')}</tr></thead>"
    return f'<div class="wide"><table>{heading}\n<tbody>\n{body}\n</tbody></table></div>'


def picture(png: bytes, description: str, caption: str) -> str:
    """A PNG inside the page."""
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img alt="{escape(description)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def definitions(pairs: dict[str, Any]) -> str:
    """Names and values, a dash for None."""
    rows = (f"<dt>{escape(k)}</dt><dd>{escape(DASH if v is None else v)}</dd>" for k, v in pairs.items())
    return "<dl>" + "".join(rows) + "</dl>"


def folded(title: str, content: str) -> str:
    """Content behind a title that opens it."""
    return f"<details><summary>{title}</summary>{content}</details>"


def page(title: str, body: str) -> str:
    """The whole document; it fetches nothing."""
    style = resources.files("evaluation").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>\n{style}</style></head>\n<body>\n{body}\n</body></html>\n"
    )

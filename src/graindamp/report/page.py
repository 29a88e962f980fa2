"""One self-contained HTML page: tables, figures and where they come from. No scripts, nothing loaded from elsewhere."""

import base64
import html
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import graindamp
from graindamp.errors import InputError
from graindamp.report.tables import Table

_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#222;max-width:1100px;margin:2rem auto;padding:0 1rem}
h1{font-size:1.6rem}h2{font-size:1.2rem;margin-top:2.2rem;border-bottom:1px solid #ddd;padding-bottom:.2rem}
table{border-collapse:collapse;font-size:13px;margin:.6rem 0}.wide{overflow-x:auto}
th,td{padding:.25rem .6rem;text-align:right;border-bottom:1px solid #e5e5e5;white-space:nowrap}
th{background:#f4f5f7}th:first-child,td:first-child{text-align:left}
img{max-width:100%;height:auto}figure{margin:1rem 0}figcaption,.note{color:#555;font-size:13px}
.warn{background:#fff6e0;border-left:4px solid #e69f00;padding:.4rem .8rem;margin:.4rem 0}
@media(prefers-color-scheme:dark){body{background:#16181c;color:#ddd}th{background:#23262c}
th,td{border-color:#333}h2{border-color:#333}.warn{background:#33290f}figcaption,.note{color:#aaa}img{background:#fff}}
"""


class Section(NamedTuple):
    """A part of a page: text, then tables, then figures with captions."""

    title: str
    text: str = ""
    tables: tuple[Table, ...] = ()
    pictures: tuple[tuple[Path, str], ...] = ()
    """PNG files and their captions; the files are taken into the page."""


def write_page(path: Path, title: str, sections: Sequence[Section], warnings: Sequence[str], inputs: str) -> Path:
    """Write the page.

    Args:
        path: where to.
        title: heading.
        sections: in order.
        warnings: shown first.
        inputs: what the results were made from, as text, shown last.

    Raises:
        InputError: the file cannot be written.
    """
    body = [f"<h1>{html.escape(title)}</h1>"]
    body += [f'<div class="warn">{html.escape(line)}</div>' for line in warnings]
    for section in sections:
        body.append(f"<h2>{html.escape(section.title)}</h2>")
        if section.text:
            body.append(f"<p>{html.escape(section.text)}</p>")
        body += [table_html(table) for table in section.tables]
        body += [_picture(picture, caption) for picture, caption in section.pictures]
    body.append(f"<h2>Made from</h2><pre>{html.escape(inputs)}</pre><p class='note'>{html.escape(_versions())}</p>")
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width,initial-scale=1"><style>{_STYLE}</style></head>'
        f"<body>{''.join(body)}</body></html>\n"
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def table_html(table: Table) -> str:
    """A table with its heading and note."""
    head = "".join(f"<th>{html.escape(column)}</th>" for column in table.columns)
    rows = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    note = f'<p class="note">{html.escape(table.note)}</p>' if table.note else ""
    return (
        f"<h3>{html.escape(table.title)}</h3><div class='wide'><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>{note}"
    )


def _picture(picture: Path, caption: str) -> str:
    data = base64.b64encode(picture.read_bytes()).decode()
    text, kind = html.escape(caption), picture.suffix[1:]
    return f'<figure><img alt="{text}" src="data:image/{kind};base64,{data}"><figcaption>{text}</figcaption></figure>'


def _versions() -> str:
    names = ("numpy", "scipy", "xarray", "matplotlib")
    used = ", ".join(f"{name} {version(name)}" for name in names)
    return f"graindamp {graindamp.__version__}, Python {platform.python_version()}, {used}"

"""From a figure to SVG text: the same bytes for the same numbers, with a title and a description inside."""

import io
import re
from html import escape

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from middeck.plot.style import house_style

# Neither a date nor versions nor the addresses of metadata vocabularies.
NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}
# Matplotlib's sheet for all elements; inside a page it would reach every other drawing.
SHEET = re.compile(r"\s*<defs>\s*<style type=\"text/css\">\*\{[^}]*\}</style>\s*</defs>")
# Ids of markers and clip paths: hashes of unrounded numbers.
HASHED = re.compile(r"\b[mp][0-9a-f]{10}\b")


def svg_text(figure: Figure, *, key: str, title: str, description: str) -> str:
    """``figure`` as SVG, ready for a file or to stand inside a page.

    Ids begin with ``key``, so that several drawings share a page; coordinates are rounded to a hundredth of
    a point; title and description are read by screen readers.
    """
    with house_style(**{"svg.hashsalt": key}):
        buffer = io.StringIO()
        # Laid out and drawn in one go; `savefig` would draw twice.
        FigureCanvasSVG(figure).print_svg(buffer, metadata=NO_METADATA)
    body = SHEET.sub("", buffer.getvalue()[buffer.getvalue().index("<svg") :], count=1)
    body = _lean(body)
    body = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{key}-", body)
    body = re.sub(r' (d|x|y)="([^"]*)"', _rounded, body)
    return _described(body, key, title, description)


def _lean(body: str) -> str:
    """``body`` with short ids, the fonts named once, and no ids of groups, indentation or turns by zero."""
    names = {name: f"{name[0]}{n}" for n, name in enumerate(dict.fromkeys(HASHED.findall(body)))}
    body = HASHED.sub(lambda match: names[match.group()], body)
    body = re.sub(r'<g id="[^"]*">', "<g>", re.sub(r"\n +", "\n", body))
    body = re.sub(r" \n(?=[LCQMz])", " ", body)
    body = re.sub(r' transform="rotate\(-0 [^"]*"', "", body)
    fonts = re.search(r'font-family: ([^;"]*)', body)
    body = re.sub(r'(?:; )?font-family: [^;"]*', "", body)
    return body.replace("<svg", f'<svg font-family="{fonts[1]}"', 1) if fonts else body


def _rounded(match: re.Match[str]) -> str:
    numbers = re.sub(r"-?\d+\.\d{3,}", lambda n: f"{float(n.group()):.2f}", match.group(2))
    return f' {match.group(1)}="{numbers}"'


def _described(body: str, key: str, title: str, description: str) -> str:
    head, rest = body.split(">", 1)
    labels = f'role="img" aria-labelledby="{key}-title {key}-description"'
    lines = 'stroke-linejoin="round" stroke-linecap="butt"'
    words = (
        f'\n<title id="{key}-title">{escape(title)}</title>'
        f'\n<desc id="{key}-description">{escape(description)}</desc>'
    )
    return f"{head} {labels} {lines}>{words}{rest}"

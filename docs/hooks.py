"""What the manual is made of besides its pages, when ``mkdocs`` builds it.

Pages link to pictures, scripts and other files of the repository by their relative paths, so that they read as well
where the repository is browsed; what they link to becomes a part of the site. The page of commands is printed by the
command line itself, and formulas become MathML, which browsers set without a library.
"""

from __future__ import annotations

import html
import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]

LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)#\s]+)")
"""Where a link or a picture of Markdown leads to, within the repository."""

SHIM = "https://unpkg.com/iframe-worker/shim"
"""A web worker for pages that are opened from a disk, which the search needs there."""

PAGES = ("CONTRIBUTING.md", "CHANGELOG.md")
"""Of the repository's root, that are pages of the manual as well."""


def site_path(path: str) -> str:
    """Where a file of the repository lies in the site: what is in docs/ at its root, all else where it is."""
    return path.removeprefix("docs/")


def repository_path(uri: str) -> str:
    """The file that lies there."""
    return f"docs/{uri}" if (ROOT / "docs" / uri).exists() else uri


def linked(path: str) -> Iterator[str]:
    """The files of the repository, outside of docs/, that a page leads to."""
    text = (ROOT / path).read_text(encoding="utf-8")
    for link in LINK.findall(text):
        target = posixpath.normpath(posixpath.join(posixpath.dirname(path), link))
        if not target.startswith("docs/") and (ROOT / target).is_file():
            yield target


def on_files(files: Any, config: Any) -> Any:
    """What pages lead to joins the site."""
    from mkdocs.structure.files import File

    pages = [repository_path(file.src_uri) for file in files.documentation_pages()]
    for path in sorted({*PAGES, *(target for page in (*pages, *PAGES) for target in linked(page))}):
        files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links lead to where their files lie in the site; the page of commands is filled in."""
    here = repository_path(page.file.src_uri)

    def moved(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(here), match[1]))
        return posixpath.relpath(site_path(target), posixpath.dirname(page.file.src_uri) or ".")

    markdown = LINK.sub(moved, markdown)
    return markdown + commands() if page.file.src_uri == "commands.md" else markdown


FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', flags=re.DOTALL)


PICTURE = re.compile(r'<img [^>]*src="([^"]+)"[^>]*>')


def on_page_content(content: str, **_: Any) -> str:
    """Formulas as MathML; and a picture leads to itself, as large as it is."""
    from latex2mathml.converter import convert

    content = FORMULA.sub(
        lambda match: convert(html.unescape(match[2]), display="block" if match[1] == "div" else "inline"), content
    )
    return PICTURE.sub(r'<a class="picture" href="\1">\g<0></a>', content)


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """The one script that the theme would load from elsewhere comes along."""
    return output.replace(SHIM, posixpath.relpath("iframe-worker.js", posixpath.dirname(page.file.dest_uri) or "."))


def on_post_template(output_content: str, **_: Any) -> str:
    """As ``on_post_page``, of the page that says that there is none."""
    return output_content.replace(SHIM, "/iframe-worker.js")


def commands() -> str:
    """Every command with its arguments and options, in Markdown, as ``--help`` says them."""
    import typer

    from cdpr_sim.cli import app

    os.environ["COLUMNS"] = "200"
    group: Any = typer.main.get_command(app)
    context = group.make_context("cdpr-sim", [], resilient_parsing=True)
    parts = []
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        inner = command.make_context(name, [], parent=context, resilient_parsing=True)
        usage = " ".join(command.collect_usage_pieces(inner))
        rows = [record for one in command.get_params(inner) if (record := one.get_help_record(inner))]
        parts += [f"\n\n## {name}\n", f"```text\ncdpr-sim {name} {usage}\n```\n", _prose(command.help), ""]
        parts += ["| argument or option | meaning |", "|---|---|"]
        parts += [f"| `{word.replace('|', '/')}` | {_prose(meaning)} |" for word, meaning in rows]
    return "\n".join([*parts, "", "## Exit status", "", _prose(app.info.epilog)])


def _prose(text: str | None) -> str:
    """As Markdown that means nothing but letters."""
    escaped = re.sub(
        r"([*_<>\[\]|])", r"\\\1", " \n\n ".join(" ".join(one.split()) for one in (text or "").split("\n\n"))
    )
    return escaped.strip()

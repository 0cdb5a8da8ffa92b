"""Hooks of ``mkdocs`` for the manual: links, the page of commands, formulas.

Pages link to pictures, scripts and other files of the repository by relative paths, so that the links also work where
the repository is browsed. The linked files are added to the site. The page of commands is generated from the command
line itself. Formulas are converted to MathML, which browsers display without a library.
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
"""The target of a link or a picture in Markdown, within the repository."""

SHIM = "https://unpkg.com/iframe-worker/shim"
"""The web worker that the search needs on pages opened from a disk."""

PAGES = ("CONTRIBUTING.md", "CHANGELOG.md", "cdpr_sim/crosscheck/problems/README.md")
"""Files outside of docs/ that are pages of the manual as well."""


def site_path(path: str) -> str:
    """Path of a repository file in the site: files of docs/ are at the root, other files keep their path."""
    return path.removeprefix("docs/")


def repository_path(uri: str) -> str:
    """Path in the repository of a file of the site; the inverse of ``site_path``."""
    return f"docs/{uri}" if (ROOT / "docs" / uri).exists() else uri


def linked(path: str) -> Iterator[str]:
    """The repository files outside of docs/ that a page links to."""
    text = (ROOT / path).read_text(encoding="utf-8")
    for link in LINK.findall(text):
        target = posixpath.normpath(posixpath.join(posixpath.dirname(path), link))
        if not target.startswith("docs/") and (ROOT / target).is_file():
            yield target


def on_files(files: Any, config: Any) -> Any:
    """Add the files that pages link to."""
    from mkdocs.structure.files import File

    pages = [repository_path(file.src_uri) for file in files.documentation_pages()]
    for path in sorted({*PAGES, *(target for page in (*pages, *PAGES) for target in linked(page))}):
        files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Replace link targets by their paths in the site, and generate the page of commands."""
    here = repository_path(page.file.src_uri)

    def moved(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(here), match[1]))
        return posixpath.relpath(site_path(target), posixpath.dirname(page.file.src_uri) or ".")

    markdown = LINK.sub(moved, markdown)
    return markdown + commands() if page.file.src_uri == "commands.md" else markdown


FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', flags=re.DOTALL)


PICTURE = re.compile(r'<img [^>]*src="([^"]+)"[^>]*>')


def on_page_content(content: str, **_: Any) -> str:
    """Convert formulas to MathML, and link each picture to its full size."""
    from latex2mathml.converter import convert

    content = FORMULA.sub(
        lambda match: convert(html.unescape(match[2]), display="block" if match[1] == "div" else "inline"), content
    )
    return PICTURE.sub(r'<a class="picture" href="\1">\g<0></a>', content)


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Load the theme's only external script from the site itself."""
    return output.replace(SHIM, posixpath.relpath("iframe-worker.js", posixpath.dirname(page.file.dest_uri) or "."))


def on_post_template(output_content: str, **_: Any) -> str:
    """Do the same as ``on_post_page`` for the page of the error 404."""
    return output_content.replace(SHIM, "/iframe-worker.js")


def commands() -> str:
    """All commands with their arguments and options, in Markdown, with the text of ``--help``."""
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
    """Escape Markdown's special characters; return plain text."""
    escaped = re.sub(
        r"([*_<>\[\]|])", r"\\\1", " \n\n ".join(" ".join(one.split()) for one in (text or "").split("\n\n"))
    )
    return escaped.strip()

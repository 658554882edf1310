"""The documents are true: commands run as printed, slugs are explained, links lead somewhere."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import make_docs
import readme_commands

ROOT = Path(__file__).parents[2]

TEXT = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "pumaid").rglob("*.py"))
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MESSAGES = (ROOT / "docs" / "messages.md").read_text(encoding="utf-8")
HEADINGS = re.findall(r"^## (.+)$", MESSAGES, re.MULTILINE)
#: Numbers of a session may differ by this share from those printed: another machine's linear algebra rounds otherwise.
SHARE = 0.02
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def test_generated_pages_are_current():
    """docs/commands.md and docs/effects.md are what the program says now."""
    assert make_docs.COMMANDS.read_text(encoding="utf-8") == make_docs.commands_page()
    assert make_docs.EFFECTS.read_text(encoding="utf-8") == make_docs.effects_page()


def test_readme_prints_two_commands():
    """Set-up takes two lines, each with a virtual environment of its own making."""
    commands = readme_commands.setup_commands(README)
    assert len(commands) == 2
    assert all(command.startswith("python3 -m venv .venv && .venv/bin/pip install ") for command in commands)


@pytest.mark.slow
@pytest.mark.skipif("```console" not in README, reason="the README shows no session")
def test_readme_sessions_print_what_they_say():
    """Every command of the README's tour prints what stands below it; numbers within 2 %."""
    old, new = (words(block) for block in (README, make_docs.run_sessions(README)))
    assert [word for word, _ in old] == [word for word, _ in new]
    numbers = [
        (a, b) for (_, before), (_, after) in zip(old, new, strict=True) for a, b in zip(before, after, strict=True)
    ]
    assert [(a, b) for a, b in numbers if abs(a - b) > SHARE * max(abs(a), abs(b))] == []


@pytest.mark.skipif(not list((ROOT / "sample_logs").glob("*/")), reason="there are no sample logs")
def test_readme_python_runs():
    """The README's Python lines run as printed, from the checkout's folder."""
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert blocks
    for block in blocks:
        done = subprocess.run([sys.executable, "-c", block], cwd=ROOT, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def words(text: str) -> list[tuple[str, list[float]]]:
    """Words of a text with their numbers taken out and apart."""
    return [(NUMBER.sub("#", word), [float(n) for n in NUMBER.findall(word)]) for word in text.split()]


def test_every_slug_is_explained():
    """What stands in brackets in a message is a heading of docs/messages.md: words with hyphens that open a call."""
    slugs = re.findall(r'\(\s*"([a-z]+(?:-[a-z]+)+)"', TEXT)
    assert len(slugs) > 150 and sorted(set(slugs) - set(HEADINGS)) == []


def test_every_explained_slug_exists():
    """docs/messages.md explains nothing that the program no longer says, and each with a paragraph."""
    assert [slug for slug in HEADINGS if f'"{slug}"' not in TEXT] == []
    assert len(HEADINGS) == len(set(HEADINGS))
    parts = re.split(r"^## .+$", MESSAGES, flags=re.MULTILINE)[1:]
    assert [part for part in parts if len(part.split()) < 8] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    """Each link to a file of the project finds it; no line ends in blanks."""
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"[ \t]$", text, re.MULTILINE)
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text)
    local = [link for link in links if not link.startswith(("http:", "https:", "mailto:"))]
    assert [link for link in local if not (page.parent / link).exists()] == []


def test_index_names_every_page():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = [str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md") if page.name != "index.md"]
    assert [page for page in pages if f"({page})" not in index] == []


def test_the_site_shows_every_page_once():
    """The menu of mkdocs.yml names every document, and nothing that is not there."""
    menu = re.findall(r"- (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(menu) == sorted(page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md"))


def test_the_citation_is_of_this_version():
    """CITATION.cff and the package state one version and one address."""
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert f"\nversion: {project['version']}\n" in citation
    assert f"\nrepository-code: {project['urls']['Homepage']}\n" in citation


def test_readme_explains_exit_codes():
    """The five exit codes that other programs rely on are in the README."""
    section = README.partition("## Exit codes")[2].split("\n## ")[0]
    assert [code for code in range(5) if f"| {code} |" not in section] == []
